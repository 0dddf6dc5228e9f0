# SPDX-License-Identifier: Apache-2.0
"""Means and variances of consecutive rows, ignoring what is not finite."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray, IntArray


def bin_means(values: FloatArray, starts: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the (m, …) means of rows starts[k] … starts[k + 1] − 1 and how many counted.

    `values` (n, …); `starts` (m + 1,) increases strictly and ends with n or less. A row counts
    where all its values are finite; a bin without one is NaN.

    >>> bin_means(np.array([1.0, 3.0, np.nan, 5.0]), np.array([0, 2, 4]))
    (array([2., 5.]), array([2, 1]))
    """
    total, count = _sums(values[: starts[-1]], starts)
    shape = (-1, *[1] * (values.ndim - 1))
    with np.errstate(invalid='ignore', divide='ignore'):
        mean: FloatArray = total / count.reshape(shape)
    return mean, count


def bin_variances(values: FloatArray, starts: IntArray, mean: FloatArray) -> FloatArray:
    """Return the (m, q) variances about `mean` within each bin, divisor rows − 1."""
    rows = np.diff(starts)
    deviation = values[: starts[-1]] - np.repeat(mean, rows, axis=0)
    total, count = _sums(deviation * deviation, starts)
    with np.errstate(invalid='ignore', divide='ignore'):
        variance: FloatArray = np.where(count > 1, total.T / (count - 1), np.nan).T
    return variance


def _sums(values: FloatArray, starts: IntArray) -> tuple[FloatArray, IntArray]:
    total: FloatArray = np.add.reduceat(values, starts[:-1], axis=0)
    if np.isfinite(total).all():
        return total, np.diff(starts)
    finite = np.isfinite(values).reshape(len(values), -1).all(axis=1)
    kept = np.where(finite.reshape(-1, *[1] * (values.ndim - 1)), values, 0.0)
    return np.add.reduceat(kept, starts[:-1], axis=0), np.add.reduceat(
        finite.astype(np.int64), starts[:-1]
    )
