# SPDX-License-Identifier: Apache-2.0
"""Rows of one triad that are clipped, stuck or spikes."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray
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
OTHERS_SIGMA = 6.0
"""Other axes stay within this where a bit went wrong on one."""
PILE = 10
"""At least this many values at the very extreme are a rail."""
PILE_RATIO = 3.0
"""A rail holds this many times more values than the steps just below it."""


def stuck_rows(values: FloatArray, period: float) -> BoolArray:
    """Return the rows (n,) in which all axes repeat the row before, for long enough."""
    same = np.zeros(len(values), dtype=bool)
    same[1:] = (values[1:] == values[:-1]).all(axis=1)
    edges = np.flatnonzero(np.diff(np.r_[False, same, False].astype(int)))
    stuck = np.zeros(len(values), dtype=bool)
    runs = edges.reshape(-1, 2)
    least = max(STUCK_ROWS, int(np.ceil(STUCK_S / period)))
    needed = _needed_repeats(runs[:, 1] - runs[:, 0], len(values), least)
    for start, stop in runs:
        if stop - start >= needed:
            stuck[start:stop] = True
    # A constant triad is no log.
    return stuck & bool(stuck.mean() < 0.9)


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
    for column in values.T:
        finite = column[np.isfinite(column)]
        if len(finite) < 100 or np.ptp(finite) == 0.0:
            continue
        noise = 1.4826 * float(np.median(np.abs(np.diff(finite)))) / np.sqrt(2.0)
        for sign in (1.0, -1.0):
            extreme = float((sign * finite).max())
            if _piles_up(sign * finite, extreme):
                with np.errstate(invalid='ignore'):
                    touched |= sign * column >= extreme - 4.0 * noise
    return touched


def spike_rows(values: FloatArray, period: float = 0.0) -> BoolArray:
    """Return the rows (n,) that stand alone, far from both neighbours."""
    spikes = np.zeros(len(values), dtype=bool)
    if len(values) < 5:
        return spikes
    limit = SPIKE_SIGMA if period < SLOW_S else SLOW_SPIKE_SIGMA
    before, here, after = values[:-2], values[1:-1], values[2:]
    jump = here - 0.5 * (before + after)
    sigma = 1.4826 * np.nanmedian(np.abs(jump - np.nanmedian(jump, axis=0)), axis=0)
    size = np.abs(jump) / np.where(sigma > 0.0, sigma, np.inf)
    with np.errstate(invalid='ignore'):
        alone = (size > limit) & (np.abs(before - after) < 0.5 * np.abs(jump))
        single = (size > OTHERS_SIGMA).sum(axis=1) == 1
    spikes[1:-1] = alone.any(axis=1) & single
    return spikes


def _piles_up(values: FloatArray, extreme: float) -> bool:
    at_rail = int((values == extreme).sum())
    if at_rail < PILE:
        return False
    others = np.unique(values[values < extreme])
    if not len(others):
        return False
    below = [int((values == other).sum()) for other in others[-3:]]
    return at_rail > PILE_RATIO * max(below)
