# SPDX-License-Identifier: Apache-2.0
"""Rows of a triad or a thermometer that are stuck, at a rail, or far from both neighbours."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray, ImuRecording
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]

STUCK_S = 4.0
"""A triad that repeats itself for longer is stuck [s]."""
STUCK_ROWS = 4
CHANCE = 1e-6
"""A run of repeats expected less often than this in the whole recording is no chance."""
SPIKE_SIGMA = 9.0
"""A row that far from its neighbours is a spike."""
SLOW_SPIKE_SIGMA = 14.0
"""The same for rows slower than SLOW_S, between which switches of the chamber show."""
SLOW_S = 2.0
LEAST_TEMPERATURE_SPIKE = 3.0
"""A die does not warm by so much for one sample [K]."""
OTHERS_SIGMA = 6.0
"""Other axes stay within this where a bit went wrong on one."""
PULSE = 0.02
"""Share of a switching channel's range by which it stands out of its neighbours."""
COARSE_SHARE = 0.95
"""Changes of one count among all from which counts are coarser than the noise."""
SMOOTH_SHARE = 0.1
"""Change from a step to the next, as a share of a step, below which values have no noise."""
FEWEST_MOVING_ROWS = 10
"""Rows with a step before and after by which that is told."""
PILE = 10
"""At least this many values at the very extreme are a rail."""
PILE_RATIO = 3.0
"""A rail holds this many times more values than the steps just below it."""


def stuck_rows(values: FloatArray, period: float) -> BoolArray:
    """Return the rows (n,) in which all axes repeat the row before, for long enough.

    Counts coarser than the noise repeat themselves while nothing changes, and leave a stretch by
    one count: what leaves it by more was stuck. Nothing is where values have no noise at all.
    """
    if _is_smooth(values):
        return np.zeros(len(values), dtype=bool)
    same = np.zeros(len(values) + 2, dtype=bool)
    for rows in pieces(len(values) - 1):
        behind = slice(rows.start + 1, rows.stop + 1)
        same[rows.start + 2 : rows.stop + 2] = (values[behind] == values[rows]).all(axis=1)
    stuck = np.zeros(len(values), dtype=bool)
    runs = np.flatnonzero(same[1:] != same[:-1]).reshape(-1, 2)
    least = max(STUCK_ROWS, int(np.ceil(STUCK_S / period)))
    needed = _needed_repeats(runs[:, 1] - runs[:, 0], len(values), least)
    count = _coarse_counts(values)
    for start, stop in runs:
        after = values[stop : stop + 1]
        jumps = len(after) and bool((np.abs(after[0] - values[start]) > 1.5 * count).any())
        if stop - start >= needed and (jumps or not count.all()):
            stuck[start:stop] = True
    # A constant triad is no log.
    return stuck & bool(stuck.mean() < 0.9)


def _is_smooth(values: FloatArray) -> bool:
    """Tell whether steps from row to row hardly differ from the one before, on every axis."""
    rows = some_rows(len(values) - 2)
    with np.errstate(invalid='ignore'):
        steps, after = values[rows + 1] - values[rows], values[rows + 2] - values[rows + 1]
    moving = ((steps != 0.0) & (after != 0.0)).all(axis=1) & np.isfinite(after - steps).all(axis=1)
    if moving.sum() < FEWEST_MOVING_ROWS:
        return False
    bend = np.median(np.abs(after - steps)[moving], axis=0)
    return bool((bend < SMOOTH_SHARE * np.median(np.abs(steps)[moving], axis=0)).all())


def _coarse_counts(values: FloatArray) -> FloatArray:
    """Return (3,) one count of each axis whose noise hardly ever passes it; 0 elsewhere.

    ∞ where an axis never changes.
    """
    counts = np.zeros(values.shape[1])
    rows = some_rows(len(values) - 1)
    with np.errstate(invalid='ignore'):
        steps = np.abs(values[rows + 1] - values[rows])
    for axis, column in enumerate(steps.T):
        moved = column[column > 0.0]
        if not len(moved):
            counts[axis] = np.inf
        elif (moved < 1.5 * moved.min()).mean() > COARSE_SHARE:
            counts[axis] = moved.min()
    return counts


def _needed_repeats(lengths: NDArray[np.int64], rows: int, least: int) -> int:
    """Return how many repeats in a row chance does not explain: rows · p^L < CHANCE.

    p is the share of repeats outside runs of L or more, so L is raised until both agree: a quiet
    triad of few quantisation steps repeats by chance, a stuck one does not raise its own limit.
    """
    needed = least
    while True:
        long = lengths >= needed
        others = rows - int(lengths[long].sum())
        share = int(lengths[~long].sum()) / max(others, 1)
        if not 0.0 < share < 1.0:
            return needed
        wanted = int(np.floor(np.log(CHANCE / rows) / np.log(share))) + 1
        if wanted <= needed:
            return needed
        needed = wanted


def rail_rows(values: FloatArray) -> BoolArray:
    """Return the rows (n,) that stand at a rail, or so near that their mean is touched by it."""
    touched = np.zeros(len(values), dtype=bool)
    # Counts coarser than the noise pile up wherever they dwell.
    for column in values.T[_coarse_counts(values) == 0.0]:
        for sign, pick in ((1.0, np.fmax), (-1.0, np.fmin)):
            extreme = float(pick.reduce(column, initial=-sign * np.inf))
            if not np.isfinite(extreme) or np.count_nonzero(column == extreme) < PILE:
                continue
            finite = column[np.isfinite(column)]
            if len(finite) < 100 or np.ptp(finite) == 0.0:
                break
            noise = 1.4826 * float(np.median(np.abs(np.diff(finite)))) / np.sqrt(2.0)
            if _piles_up(sign * finite, sign * extreme):
                with np.errstate(invalid='ignore'):
                    touched |= sign * column >= sign * extreme - 4.0 * noise
    return touched


def spike_rows(values: FloatArray, period: float = 0.0) -> BoolArray:
    """Return the rows (n,) that stand alone, far from both neighbours."""
    spikes = np.zeros(len(values), dtype=bool)
    if len(values) < 5:
        return spikes
    limit = SPIKE_SIGMA if period < SLOW_S else SLOW_SPIKE_SIGMA
    centre = some_rows(len(values) - 2) + 1
    jump = values[centre] - 0.5 * (values[centre - 1] + values[centre + 1])
    sigma = np.array([_robust_sigma(column) for column in jump.T])
    sigma = np.where(sigma > 0.0, sigma, np.inf)
    at = np.flatnonzero(far_rows(np.ascontiguousarray(values), limit * sigma))
    if len(at):
        before, here, after = values[at - 1], values[at], values[at + 1]
        jump = np.abs(here - 0.5 * (before + after))
        alone = (jump > limit * sigma) & (np.abs(before - after) < 0.5 * jump)
        single = (jump > OTHERS_SIGMA * sigma).sum(axis=1) == 1
        spikes[at] = alone.any(axis=1) & single
    return spikes


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
    limit = max(LEAST_TEMPERATURE_SPIKE, SLOW_SPIKE_SIGMA * sigma)
    spikes = far_rows(np.ascontiguousarray(values)[:, None], np.array([limit]))
    at = np.flatnonzero(spikes)
    jump = np.abs(values[at] - 0.5 * (values[at - 1] + values[at + 1]))
    spikes[at] = np.abs(values[at - 1] - values[at + 1]) < 0.5 * jump
    rows: BoolArray = np.repeat(spikes, np.diff(np.append(first, len(recording))))
    return rows


def pulsed_rows(channel: FloatArray) -> BoolArray:
    """Return the rows (n,) in which a channel (n,) that switches stands off both neighbours.

    What it does to a sensor for one row is no spike of the sensor.
    """
    pulsed = np.zeros(len(channel), dtype=bool)
    span = np.nanmax(channel, initial=-np.inf) - np.nanmin(channel, initial=np.inf)
    if len(channel) > 2 and span > 0.0:
        with np.errstate(invalid='ignore'):
            jump = np.abs(channel[1:-1] - 0.5 * (channel[:-2] + channel[2:]))
            pulsed[1:-1] = jump > PULSE * span
    return pulsed


def _robust_sigma(values: FloatArray) -> float:
    """Return 1.4826 times the median absolute deviation of what is finite, 0 for nothing."""
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


def some_rows(rows: int, wanted: int = 200_000) -> NDArray[np.intp]:
    """Return about so many of the rows, evenly spread: enough for a median."""
    return np.arange(0, rows, max(rows // wanted, 1))


def _piles_up(values: FloatArray, extreme: float) -> bool:
    at_rail = int((values == extreme).sum())
    if at_rail < PILE:
        return False
    others = np.unique(values[values < extreme])
    if not len(others):
        return False
    below = [int((values == other).sum()) for other in others[-3:]]
    return at_rail > PILE_RATIO * max(below)
