# SPDX-License-Identifier: Apache-2.0
"""The counts that a thermometer is read in: steps of its converter, or decimals of a log."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.data.rounding import some_rows

MOST_COUNTS = 5000
"""Counts between the lowest and the highest reading; of more one is a spike."""
LATTICE_ROUNDS = 20
"""Times the step of the counts is taken from all of them, first from the smallest."""
DECIMALS = 4
"""To which readings are alike."""
SPIKE_SHARE, LARGEST_OFF_LATTICE = 1e-3, 0.2
"""Share of the readings at either end that may be spikes, and distance from a count that rounding
to decimals makes [counts]."""


def counts_of(readings: FloatArray) -> tuple[float, ...]:
    """Return the ascending counts of a thermometer [°C] by readings, those it skipped included.

    Rounded to decimals they are at unequal distances. Empty of one without counts, or of a single
    one.
    """
    some = readings[some_rows(len(readings))]
    some = np.round(some[np.isfinite(some)], DECIMALS)
    if not len(some):
        return ()
    low, high = np.quantile(some, (SPIKE_SHARE, 1.0 - SPIKE_SHARE))
    found = np.unique(some[(some >= low) & (some <= high)])
    if not 2 <= len(found) <= MOST_COUNTS:
        return ()
    number = _on_a_lattice(found)
    if number[-1] > MOST_COUNTS:
        return ()
    step, first = np.polyfit(number, found, 1)
    if np.abs(found - first - step * number).max() > LARGEST_OFF_LATTICE * step:
        return ()
    return tuple(np.interp(np.arange(number[-1] + 1), number, found).tolist())


def _on_a_lattice(found: FloatArray) -> IntArray:
    """Return (l,) whole numbers that ascending readings are alike to, if rounded to decimals."""
    step, number = float(np.diff(found).min()), np.zeros(len(found), np.int64)
    for _ in range(LATTICE_ROUNDS):
        number[1:] = np.cumsum(np.rint(np.diff(found) / step))
        step = float(np.polyfit(number, found, 1)[0])
    return number
