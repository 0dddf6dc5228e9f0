# SPDX-License-Identifier: Apache-2.0
"""The start-up transient of a recording: all channels rise to their levels by one common factor.

A filter that started at zero scales gravity and field alike; temperature and motion do not. What
settles slowly is told by its form, an exponential that is common to the channels. A thermometer
that was not read yet shows what it showed before, or what its register holds by default.
"""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording
from numpy.typing import NDArray

SETTLING_WINDOWS_S = (600.0, 2400.0, 9600.0)
"""The settled level is that of the second half of the first of these [s] that is long enough."""
SHORT_WINDOW_S = 600.0
"""A transient that outlasts this window [s] is looked for as an exponential as well."""
LEAST_DEVIATION = 0.02
"""Common deviation from the settled level, as a share of it, that is a start-up."""
LEAST_FIRST_DEVIATION = 0.1
"""Least such deviation of the first sample; temperature moves a level by less."""
CHANNEL_SPREAD_SHARE = 0.25
"""Spread of the channels about the common deviation, at most, as a share of it."""
SETTLED_REMAINDER = 1e-5
"""Share of the level that may still be missing where a start-up is called over."""
LEAST_LEVEL_SIGMA = 20.0
"""Least level of a channel that counts, in standard deviations of its noise."""
DECAY_WINDOWS_S = (1200.0, 2400.0, 3600.0)
"""Lengths of the beginning that an exponential is fitted to [s]."""
TIME_CONSTANTS_S = np.geomspace(20.0, 2000.0, 121)
"""Time constants that it may have [s]."""
LEAST_MISSING_SHARE = 0.1
"""Least share of the level that is missing at first."""
ALIKE_TOLERANCE = 0.1
"""Largest relative difference of a channel from what is missing of the others."""
ALIKE_SHARE = 0.6
"""Least share of the channels within ALIKE_TOLERANCE: a gyroscope's level moves with
temperature."""
UNEXPLAINED_SHARE = 0.005
"""Median share of the channels' variance that a fit may leave beyond their noise."""
FIT_VARIANCE_RATIO = 1.5
"""Variance about a fit, over that of white noise as rows differ: slow noise adds some."""
STALE_K, STALE_RATIO = 1.0, 5.0
"""Least jump of a thermometer from one row to the next [K], and least ratio to every other step of
the recording, from which what was before it is stale …"""
STALE_S, STALE_SHARE = 60.0, 0.05
"""… and the beginning in which such a jump is looked for [s], as a share of the recording."""
MEDIAN_OF_SQUARE = 0.455
"""Median of the square of a normal variable of unit variance."""


def cut_startup(recording: ImuRecording) -> ImuRecording:
    """Return the recording without its start-up transient, with a note where one was cut.

    >>> import numpy as np
    >>> n = np.ones((400, 3))
    >>> f = np.minimum(0.54 + 0.1 * np.arange(400.0), 1.0)[:, None]
    >>> stamp, warm = np.arange(400) * 10**9, 20.0 * n[:, 0]
    >>> raw = ImuRecording(stamp, 0 * n, 9.8 * n * f, 4e-5 * n * f, warm)
    >>> len(cut_startup(raw)), cut_startup(raw).notes[0]
    (395, 'start-up transient cut: 5 samples, 5.0 s, first at 0.54 of the level')
    """
    rows, said = startup_rows(recording)
    if not rows:
        return recording
    seconds = (recording.stamp[rows] - recording.stamp[0]) * 1e-9
    return recording.rows(slice(rows, None)).with_notes(
        f'start-up transient cut: {rows} samples, {seconds:.1f} s, {said}'
    )


def startup_rows(recording: ImuRecording) -> tuple[int, str]:
    """Return how many first rows are a start-up, and how they differ from those after them."""
    filling, factor = _filling_rows(recording)
    stale, jump = _stale_rows(recording)
    if stale > filling:
        side = 'above' if jump > 0.0 else 'below'
        return stale, f'their temperature {abs(jump):.1f} K {side} the next'
    return filling, f'first at {factor:.2f} of the level'


def _stale_rows(recording: ImuRecording) -> tuple[int, float]:
    """Return how many first rows a thermometer was not read in, and how far it was off [K].

    No die jumps; a thermometer does once, when it is first read.
    """
    known = np.flatnonzero(np.isfinite(recording.temperature))
    if len(known) < 3:
        return 0, 0.0
    seconds, steps = recording.time, np.diff(recording.temperature[known])
    place = int(np.argmax(np.abs(steps)))
    jump = abs(float(steps[place]))
    others = float(np.abs(np.delete(steps, place)).max())
    begun = seconds[known[place + 1]] <= min(STALE_S, STALE_SHARE * seconds[-1])
    stale = begun and jump >= STALE_K and jump > STALE_RATIO * others
    return (int(known[place + 1]), -float(steps[place])) if stale else (0, 0.0)


def _filling_rows(recording: ImuRecording) -> tuple[int, float]:
    """Return how many first rows filters fill up in, and the first row's common factor.

    While filters that started at zero fill up, all large channels have the same ratio to their
    settled levels.
    """
    for seconds in SETTLING_WINDOWS_S:
        window = recording.rows(slice(0, int(np.searchsorted(recording.time, seconds))))
        common, noise, first = _common_factor(window)
        if not first:
            return 0, 1.0
        if seconds > SHORT_WINDOW_S and (slow := _slow_rows(recording)) is not None:
            return slow
        off = np.abs(common - 1.0)
        # Temperature moves the settled channels too; a start-up is over within what it does.
        drift = float(np.quantile(off[len(off) // 2 :], 0.95))
        threshold = max(3.0 * noise, 1e-3, min(drift, LEAST_DEVIATION))
        settled = off[first:] <= threshold
        rows = first + (int(np.argmax(settled)) if settled.any() else len(settled))
        if rows < len(window) / 3:
            break
    else:
        return 0, 1.0
    if rows > 10 and threshold > SETTLED_REMAINDER:
        # What decays exponentially is below the noise long before it is gone.
        over = int(np.ceil(rows * np.log(off[0] / SETTLED_REMAINDER) / np.log(off[0] / threshold)))
        # More than half of a short recording is not given up for the last of a tail.
        rows = max(rows, min(over, len(recording) // 2 - 1))
    return (rows, float(common[0])) if rows < len(recording) / 2 else (0, 1.0)


def _slow_rows(recording: ImuRecording) -> tuple[int, float] | None:
    """Return the rows and first factor of a common exponential that ends before the middle."""
    soon, late = np.searchsorted(recording.time, SETTLING_WINDOWS_S[-2:])
    values = _channels(recording.rows(slice(0, int(late))))
    decay = decay_of(recording.time[:late], values[:, _large_ratios(values[:soon])[1]])
    if decay is None:
        return None
    share, constant = decay
    rows = int(
        np.searchsorted(recording.time, constant * float(np.log(share / SETTLED_REMAINDER)))
    )
    return (rows, 1.0 - share) if rows < len(recording) / 2 else None


def _channels(window: ImuRecording) -> FloatArray:
    """Return (n, 9) all channels, values that are not finite replaced by the newest that is."""
    values = np.hstack(
        [window.linear_acceleration, window.angular_velocity, window.magnetic_field]
    )
    return _with_newest_finite(values)


def _common_factor(window: ImuRecording) -> tuple[FloatArray, float, int]:
    """Return the large channels' common factor (n,), its noise, and how many first rows are off.

    Rows are off while the factor differs from one and the channels agree on it; none are where it
    starts near one.
    """
    if len(window) < 10 or (ratio := _large_ratios(_channels(window))[0]).shape[1] < 2:
        return np.ones(1), 0.0, 0
    common: FloatArray = np.median(ratio, axis=1)
    noise = 1.4826 * float(np.median(np.abs(np.diff(common)))) / np.sqrt(2.0)
    off = np.abs(common - 1.0)
    apart = np.median(np.abs(ratio - common[:, None]), axis=1)
    alike = apart <= CHANNEL_SPREAD_SHARE * off + 3.0 * noise
    first = _first_false((off > max(LEAST_DEVIATION, 10.0 * noise)) & alike)
    return common, noise, first if off[0] >= LEAST_FIRST_DEVIATION else 0


def _large_ratios(values: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the columns far above their noise over their settled level, and which these are."""
    level = np.median(values[len(values) // 2 :], axis=0)
    spread = 1.4826 * np.median(np.abs(np.diff(values, axis=0)), axis=0) / np.sqrt(2.0)
    large = np.abs(level) > np.maximum(LEAST_LEVEL_SIGMA * spread, 1e-300)
    ratios: FloatArray = values[:, large] / level[large]
    return ratios, large


def _with_newest_finite(values: FloatArray) -> FloatArray:
    """Return the columns with every value that is not finite replaced by the newest that is."""
    finite = np.isfinite(values)
    row = np.where(finite, np.arange(len(values))[:, None], 0)
    newest = np.maximum(np.maximum.accumulate(row, axis=0), np.argmax(finite, axis=0))
    held: FloatArray = np.take_along_axis(values, newest, axis=0)
    return held


def _first_false(flags: NDArray[np.bool_]) -> int:
    """Return the number of leading true flags."""
    return len(flags) if flags.all() else int(np.argmin(flags))


def decay_of(time: FloatArray, values: FloatArray) -> tuple[float, float] | None:
    """Return the share missing at first and the time constant [s]; None where there is none.

    Most of the channels (n, k) are c · (1 − A · e^{−t/τ}) with A and τ common to them: a
    temperature moves each by an amount of its own, a filter that started at zero does not.
    """
    for length in DECAY_WINDOWS_S:
        window = time < length
        if window.sum() < 30 or time[-1] < 2.0 * length:
            continue
        found = _fitted_decay(time[window], values[window])
        if found is not None and found[1] < length / 2.0:
            return found
    return None


def _fitted_decay(time: FloatArray, values: FloatArray) -> tuple[float, float] | None:
    """Return what `decay_of` does, for one length of the beginning."""
    total = np.maximum(values.var(axis=0), 1e-300)
    noise = 0.5 * np.median(np.diff(values, axis=0) ** 2, axis=0) / MEDIAN_OF_SQUARE
    best, left_over, missing = 0.0, np.inf, np.zeros(1)
    for constant in TIME_CONSTANTS_S:
        basis = np.column_stack([np.ones_like(time), np.exp(-time / constant)])
        answer, *_ = np.linalg.lstsq(basis, values, rcond=None)
        left = float(
            np.median(((values - basis @ answer).var(axis=0) - FIT_VARIANCE_RATIO * noise) / total)
        )
        if left < left_over:
            best, left_over, missing = float(constant), left, -answer[1] / answer[0]
    share = float(np.median(missing))
    alike = np.abs(missing - share) <= ALIKE_TOLERANCE * abs(share)
    if left_over > UNEXPLAINED_SHARE or share < LEAST_MISSING_SHARE or alike.mean() < ALIKE_SHARE:
        return None
    return share, best
