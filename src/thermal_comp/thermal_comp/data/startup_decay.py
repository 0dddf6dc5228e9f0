# SPDX-License-Identifier: Apache-2.0
"""A start-up slower than the time its channels take to settle: a common exponential."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray

WINDOWS_S = (1200.0, 2400.0, 3600.0)
"""Lengths of the beginning it is fitted to [s]."""
TIME_CONSTANTS_S = np.geomspace(20.0, 2000.0, 121)
LEAST_MISSING = 0.1
"""Share of the level that is missing at first."""
ALIKE_TOLERANCE = 0.1
"""Channels may differ by this share of what is missing …"""
ALIKE_SHARE = 0.6
"""… and this share of them has to agree: a gyroscope's level moves with temperature."""
UNEXPLAINED_SHARE = 0.005
"""Share of a channel's variance in the window that may be left beyond its noise, by median."""
FIT_VARIANCE_RATIO = 1.5
"""Variance about a fit, in that of the differences of rows: slow noise adds some."""
MEDIAN_OF_SQUARE = 0.455
"""Of a normal variable of unit variance."""


def decay_of(time: FloatArray, values: FloatArray) -> tuple[float, float] | None:
    """Return the share missing at first and the time constant [s]; None where there is none.

    Most of the channels (n, k) are c · (1 − A · e^{−t/τ}) with A and τ common to them: a
    temperature moves each by an amount of its own, a filter that started at zero does not.
    """
    for length in WINDOWS_S:
        window = time < length
        if window.sum() < 30 or time[-1] < 2.0 * length:
            continue
        found = _fitted(time[window], values[window])
        if found is not None and found[1] < length / 2.0:
            return found
    return None


def _fitted(time: FloatArray, values: FloatArray) -> tuple[float, float] | None:
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
    if left_over > UNEXPLAINED_SHARE or share < LEAST_MISSING or alike.mean() < ALIKE_SHARE:
        return None
    return share, best
