# SPDX-License-Identifier: Apache-2.0
"""Rows of a triad or a thermometer that are stuck, at a rail, or far from both neighbours."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray, ImuRecording, IntArray
from numpy.typing import NDArray

from thermal_comp.data.rounding import coarse_counts, some_rows

BoolArray = NDArray[np.bool_]

LEAST_STUCK_S, LEAST_STUCK_ROWS = 4.0, 4
"""Time [s] and rows for which a triad has to repeat itself to be stuck."""
EXPECTED_CHANCE_RUNS = 1e-6
"""Expected number in a recording of runs of repeats as long, below which a run is no chance."""
SPIKE_SIGMA = 9.0
"""Distance from its neighbours, in standard deviations, from which a row is a spike."""
SLOW_SPIKE_SIGMA = 14.0
"""The same for rows further apart than SLOW_PERIOD_S: switches of the chamber show in them."""
SLOW_PERIOD_S = 2.0
"""[s]."""
LEAST_TEMPERATURE_SPIKE_K = 3.0
"""Distance of a die temperature from its neighbours, at least, in a spike [K]."""
SPIKE_STRETCH_ROWS = 64
"""Rows of a stretch whose own noise counts: a motor may run in it."""
OTHER_AXES_SIGMA = 6.0
"""Distance of the other axes, at most, in a spike: a bit went wrong on one axis."""
LEAST_PULSE_SHARE = 0.02
"""Distance of a pulse from both neighbours, at least, as a share of the channel's range."""
LARGEST_BEND_SHARE = 0.1
"""Median change from step to step, as a share of a step, below which values have no noise."""
LEAST_MOVING_ROWS = 10
"""Rows with a step before and after that this needs."""
LEAST_RAIL_VALUES = 10
"""Least number of values at the very extreme that make a rail."""
LEAST_RAIL_RATIO = 3.0
"""Least ratio of that number to those at the steps just below."""


def stuck_rows(values: FloatArray, period: float) -> BoolArray:
    """Return the rows (n,) in which all axes repeat the row before, for long enough.

    Counts coarser than the noise repeat themselves while nothing changes, and leave such a stretch
    by one count; a triad that leaves it by more was stuck. Values without noise are never stuck.
    """
    if _is_smooth(values):
        return np.zeros(len(values), dtype=bool)
    same = np.zeros(len(values) + 2, dtype=bool)
    for rows in pieces(len(values) - 1):
        behind = slice(rows.start + 1, rows.stop + 1)
        same[rows.start + 2 : rows.stop + 2] = (values[behind] == values[rows]).all(axis=1)
    stuck = np.zeros(len(values), dtype=bool)
    runs = np.flatnonzero(same[1:] != same[:-1]).reshape(-1, 2)
    least = max(LEAST_STUCK_ROWS, int(np.ceil(LEAST_STUCK_S / period)))
    lengths = runs[:, 1] - runs[:, 0]
    long = runs[lengths >= _needed_repeats(lengths, len(values), least)]
    count = coarse_counts(values) if len(long) else np.zeros(0)
    for start, stop in long:
        after = values[stop : stop + 1]
        jumps = len(after) and bool((np.abs(after[0] - values[start]) > 1.5 * count).any())
        if jumps or not count.all():
            stuck[start:stop] = True
    # A triad that is stuck throughout was not measured at all: told elsewhere.
    return stuck & bool(stuck.mean() < 0.9)


def _is_smooth(values: FloatArray) -> bool:
    """Tell whether values have no noise: on every axis a step is nearly the one before it."""
    rows = some_rows(len(values) - 2)
    with np.errstate(invalid='ignore'):
        steps, after = values[rows + 1] - values[rows], values[rows + 2] - values[rows + 1]
    moving = ((steps != 0.0) & (after != 0.0)).all(axis=1) & np.isfinite(after - steps).all(axis=1)
    if moving.sum() < LEAST_MOVING_ROWS:
        return False
    bend = np.median(np.abs(after - steps)[moving], axis=0)
    return bool((bend < LARGEST_BEND_SHARE * np.median(np.abs(steps)[moving], axis=0)).all())


def _needed_repeats(lengths: NDArray[np.int64], rows: int, least: int) -> int:
    """Return how many repeats L in a row are no chance: rows · p^L < EXPECTED_CHANCE_RUNS.

    p is the share of repeats outside runs of L or more, so that L is raised until both agree: a
    quiet triad of few quantisation steps repeats by chance, and a long run must not count in p.
    """
    needed = least
    while True:
        long = lengths >= needed
        others = rows - int(lengths[long].sum())
        share = int(lengths[~long].sum()) / max(others, 1)
        if not 0.0 < share < 1.0:
            return needed
        wanted = int(np.floor(np.log(EXPECTED_CHANCE_RUNS / rows) / np.log(share))) + 1
        if wanted <= needed:
            return needed
        needed = wanted


def rail_rows(values: FloatArray) -> BoolArray:
    """Return the rows (n,) at a rail, or so near that its clipping shifts their mean."""
    touched = np.zeros(len(values), dtype=bool)
    # Counts coarser than the noise repeat wherever the signal rests: that is no rail.
    for column in values.T[coarse_counts(values) == 0.0]:
        for sign, pick in ((1.0, np.fmax), (-1.0, np.fmin)):
            extreme = float(pick.reduce(column, initial=-sign * np.inf))
            if not np.isfinite(extreme) or np.count_nonzero(column == extreme) < LEAST_RAIL_VALUES:
                continue
            finite = column[np.isfinite(column)]
            if len(finite) < 100 or np.ptp(finite) == 0.0:
                break
            noise = 1.4826 * float(np.median(np.abs(np.diff(finite)))) / np.sqrt(2.0)
            if _is_rail(sign * finite, sign * extreme):
                with np.errstate(invalid='ignore'):
                    touched |= sign * column >= sign * extreme - 4.0 * noise
    return touched


def spike_rows(values: FloatArray, period: float = 0.0) -> BoolArray:
    """Return the rows (n,) in which one axis alone is far from both neighbours."""
    spikes = np.zeros(len(values), dtype=bool)
    if len(values) < 5:
        return spikes
    limit = SPIKE_SIGMA if period < SLOW_PERIOD_S else SLOW_SPIKE_SIGMA
    centre = some_rows(len(values) - 2) + 1
    jump = values[centre] - 0.5 * (values[centre - 1] + values[centre + 1])
    sigma = np.array([_robust_sigma(column) for column in jump.T])
    sigma = np.where(sigma > 0.0, sigma, np.inf)
    at = np.flatnonzero(far_rows(np.ascontiguousarray(values), limit * sigma))
    if len(at):
        before, here, after = values[at - 1], values[at], values[at + 1]
        jump = np.abs(here - 0.5 * (before + after))
        sigma = np.maximum(sigma, _sigma_around(values, at))
        alone = (jump > limit * sigma) & (np.abs(before - after) < 0.5 * jump)
        single = (jump > OTHER_AXES_SIGMA * sigma).sum(axis=1) == 1
        spikes[at] = alone.any(axis=1) & single
    return spikes


def _sigma_around(values: FloatArray, rows: IntArray) -> FloatArray:
    """Return (k, axes) robust deviations from both neighbours around k rows of (n, axes) values.

    It is the largest of three stretches, that of the row and those beside it: a device that is
    shaken for a while has no spikes.
    """
    length = min(SPIKE_STRETCH_ROWS, len(values) - 2)
    count = (len(values) - 2) // length
    stretch = np.minimum((rows - 1) // length, count - 1)
    found = np.empty((len(rows), values.shape[1]))
    for some in np.array_split(np.unique(stretch), len(rows) // length + 1):
        near = np.clip(some[:, None] + np.arange(-1, 2), 0, count - 1)
        index = 1 + length * near[:, :, None] + np.arange(length)
        jump = values[index] - 0.5 * (values[index - 1] + values[index + 1])
        away = np.nan_to_num(np.abs(jump), posinf=0.0)
        around = 1.4826 * np.median(away, axis=2).max(axis=1)
        here = np.isin(stretch, some)
        found[here] = around[np.searchsorted(some, stretch[here])]
    return found


def temperature_spikes(recording: ImuRecording) -> BoolArray:
    """Return the rows (n,) whose die temperature leaves that of both neighbours and comes back.

    Neighbours are measurements, not the rows that hold them.
    """
    values, measured = recording.temperature, recording.temperature_stamp
    first = np.arange(len(values))
    if measured is not None:
        first = np.flatnonzero(np.diff(measured, prepend=measured[:1] - 1))
        values = values[first]
    if len(values) < 5:
        return np.zeros(len(recording), dtype=bool)
    centre = some_rows(len(values) - 2) + 1
    sigma = _robust_sigma(values[centre] - 0.5 * (values[centre - 1] + values[centre + 1]))
    limit = max(LEAST_TEMPERATURE_SPIKE_K, SLOW_SPIKE_SIGMA * sigma)
    spikes = far_rows(np.ascontiguousarray(values)[:, None], np.array([limit]))
    at = np.flatnonzero(spikes)
    jump = np.abs(values[at] - 0.5 * (values[at - 1] + values[at + 1]))
    spikes[at] = np.abs(values[at - 1] - values[at + 1]) < 0.5 * jump
    rows: BoolArray = np.repeat(spikes, np.diff(np.append(first, len(recording))))
    return rows


def pulsed_rows(channel: FloatArray) -> BoolArray:
    """Return the rows (n,) in which a channel (n,) that switches differs from both neighbours.

    What such a pulse does to a sensor in that row is no spike of the sensor.
    """
    pulsed = np.zeros(len(channel), dtype=bool)
    span = np.nanmax(channel, initial=-np.inf) - np.nanmin(channel, initial=np.inf)
    if len(channel) > 2 and span > 0.0:
        with np.errstate(invalid='ignore'):
            jump = np.abs(channel[1:-1] - 0.5 * (channel[:-2] + channel[2:]))
            pulsed[1:-1] = jump > LEAST_PULSE_SHARE * span
    return pulsed


def _robust_sigma(values: FloatArray) -> float:
    """Return 1.4826 times the median absolute deviation of the finite values, 0 without any."""
    known = values[np.isfinite(values)]
    if not len(known):
        return 0.0
    return 1.4826 * float(np.median(np.abs(known - np.median(known))))


@njit
def far_rows(values: FloatArray, limit: FloatArray) -> BoolArray:
    """Return the inner rows of (n, k) that differ from the mean of both neighbours by more."""
    rows, axes = values.shape
    far = np.zeros(rows, dtype=np.bool_)
    for row in range(1, rows - 1):
        for axis in range(axes):
            between = 0.5 * (values[row - 1, axis] + values[row + 1, axis])
            if abs(values[row, axis] - between) > limit[axis]:
                far[row] = True
    return far


def pieces(rows: int, length: int = 1 << 15) -> Iterator[slice]:
    """Yield slices over rows that stay in the processor's cache."""
    for start in range(0, rows, length):
        yield slice(start, min(start + length, rows))


def _is_rail(values: FloatArray, extreme: float) -> bool:
    """Tell whether many more values are at the extreme than at the steps below it."""
    at_rail = int((values == extreme).sum())
    if at_rail < LEAST_RAIL_VALUES:
        return False
    others = np.unique(values[values < extreme])
    if not len(others):
        return False
    below = [int((values == other).sum()) for other in others[-3:]]
    return at_rail > LEAST_RAIL_RATIO * max(below)
