# SPDX-License-Identifier: Apache-2.0
"""Differences D of a sequence, and the banded matrix of their weighted squares, Dᵀ diag(w) D."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray


def difference(order: int) -> FloatArray:
    """Return the (order + 1,) weights of values in a difference.

    >>> difference(3)
    array([-1.,  3., -3.,  1.])
    """
    return np.asarray(np.diff(np.eye(order + 1), order, axis=0)[0])


def settling_differences(
    size: int, order: int, deviation: float, time_constant: float
) -> FloatArray:
    """Return (size − order,) deviations of the differences of what settles from a start.

    It is one of `deviation` that dies out with a time constant [rows]; of 0 there is none.
    """
    if time_constant <= 0.0:
        return np.zeros(size - order)
    first = deviation * (1.0 - np.exp(-1.0 / time_constant)) ** order
    return np.asarray(first * np.exp(-np.arange(size - order) / time_constant))


def penalty_bands(order: int, weights: FloatArray) -> FloatArray:
    """Return the upper bands (order + 1, n) of Dᵀ diag(w) D, `weights` (n − order,).

    They are laid out as `scipy.linalg.cholesky_banded` takes them: the diagonal comes last.
    """
    values, size = difference(order), len(weights)
    bands = np.zeros((order + 1, size + order))
    for row, one in enumerate(values):
        for column in range(row, order + 1):
            bands[order - (column - row), column : column + size] += one * values[column] * weights
    return bands
