# SPDX-License-Identifier: Apache-2.0
"""The start-up transient of an acquisition: all channels of a device ramp by one common factor."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording
from numpy.typing import NDArray

from thermal_comp.data.startup_decay import decay_of

WINDOWS_S = (600.0, 2400.0, 9600.0)
"""The settled level is that of the second half of the first of these [s] that is long enough."""
SOON_S = 600.0
"""What is not over within a window this long [s] may be an exponential, told by its form."""
TRIGGER = 0.02
"""Common deviation from the settled level above which the first samples are a start-up."""
FIRST = 0.1
"""The first sample is off by more than this; temperature moves a level by less."""
AGREEMENT = 0.25
"""Channels may differ by this share of the common deviation."""
REMAINDER = 1e-5
"""A start-up is over when this share of the level is still missing."""
LARGE = 20.0
"""A channel counts when its level is this many standard deviations of its noise."""


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
    rows, factor = startup_rows(recording)
    if not rows:
        return recording
    seconds = (recording.stamp[rows] - recording.stamp[0]) * 1e-9
    return recording.rows(slice(rows, None)).with_notes(
        f'start-up transient cut: {rows} samples, {seconds:.1f} s, '
        f'first at {factor:.2f} of the level'
    )


def startup_rows(recording: ImuRecording) -> tuple[int, float]:
    """Return how many first rows are a start-up transient, and the first row's common factor.

    The ratio of each large channel to its settled level is the same for all of them while filters
    that started at zero fill up; a motion or a temperature never scales gravity and field alike.
    """
    for seconds in WINDOWS_S:
        window = recording.rows(slice(0, int(np.searchsorted(recording.time, seconds))))
        common, noise, first = _common_factor(window)
        if not first:
            return 0, 1.0
        if seconds > SOON_S and (slow := _slow_rows(recording)) is not None:
            return slow
        off = np.abs(common - 1.0)
        # Temperature moves the settled channels too; a start-up is over within what it does.
        drift = float(np.quantile(off[len(off) // 2 :], 0.95))
        threshold = max(3.0 * noise, 1e-3, min(drift, TRIGGER))
        settled = off[first:] <= threshold
        rows = first + (int(np.argmax(settled)) if settled.any() else len(settled))
        if rows < len(window) / 3:
            break
    else:
        return 0, 1.0
    if rows > 10 and threshold > REMAINDER:
        # What decays exponentially is below the noise long before it is gone.
        over = int(np.ceil(rows * np.log(off[0] / REMAINDER) / np.log(off[0] / threshold)))
        # More than half of a short recording is not given up for the last of a tail.
        rows = max(rows, min(over, len(recording) // 2 - 1))
    return (rows, float(common[0])) if rows < len(recording) / 2 else (0, 1.0)


def _slow_rows(recording: ImuRecording) -> tuple[int, float] | None:
    """Return how many first rows a common exponential lasts that ends before the middle."""
    soon, late = np.searchsorted(recording.time, WINDOWS_S[-2:])
    values = _channels(recording.rows(slice(0, int(late))))
    decay = decay_of(recording.time[:late], values[:, _large_ratios(values[:soon])[1]])
    if decay is None:
        return None
    share, constant = decay
    rows = int(np.searchsorted(recording.time, constant * float(np.log(share / REMAINDER))))
    return (rows, 1.0 - share) if rows < len(recording) / 2 else None


def _channels(window: ImuRecording) -> FloatArray:
    """(n, 9) all channels, values that are not finite replaced by the newest that is."""
    values = np.hstack(
        [window.linear_acceleration, window.angular_velocity, window.magnetic_field]
    )
    return _held(values)


def _common_factor(window: ImuRecording) -> tuple[FloatArray, float, int]:
    """Return the large channels' common factor (n,), its noise, and its first rows off one.

    The rows count while the channels agree, and not at all where the factor starts near one.
    """
    if len(window) < 10 or (ratio := _large_ratios(_channels(window))[0]).shape[1] < 2:
        return np.ones(1), 0.0, 0
    common: FloatArray = np.median(ratio, axis=1)
    noise = 1.4826 * float(np.median(np.abs(np.diff(common)))) / np.sqrt(2.0)
    off = np.abs(common - 1.0)
    apart = np.median(np.abs(ratio - common[:, None]), axis=1)
    alike = apart <= AGREEMENT * off + 3.0 * noise
    first = _first_false((off > max(TRIGGER, 10.0 * noise)) & alike)
    return common, noise, first if off[0] >= FIRST else 0


def _large_ratios(values: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the columns that stand far above their noise, over their settled level; and which."""
    level = np.median(values[len(values) // 2 :], axis=0)
    spread = 1.4826 * np.median(np.abs(np.diff(values, axis=0)), axis=0) / np.sqrt(2.0)
    large = np.abs(level) > np.maximum(LARGE * spread, 1e-300)
    ratios: FloatArray = values[:, large] / level[large]
    return ratios, large


def _held(values: FloatArray) -> FloatArray:
    """Return the columns with every value that is not finite replaced by the newest that is."""
    finite = np.isfinite(values)
    row = np.where(finite, np.arange(len(values))[:, None], 0)
    newest = np.maximum(np.maximum.accumulate(row, axis=0), np.argmax(finite, axis=0))
    held: FloatArray = np.take_along_axis(values, newest, axis=0)
    return held


def _first_false(flags: NDArray[np.bool_]) -> int:
    """Return the number of leading true flags."""
    return len(flags) if flags.all() else int(np.argmin(flags))
