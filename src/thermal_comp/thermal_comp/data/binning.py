# SPDX-License-Identifier: Apache-2.0
"""Means and variances of consecutive rows, and vibration as the variance of acceleration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from imu_recording.recording import FloatArray, IntArray

VIBRATION_INTERVAL_NS = 1_000_000_000
"""Interval whose variance of acceleration is the vibration [ns]."""
LEAST_SAMPLES = 45
"""Samples in an interval (about 50 Hz) below which it tells no vibration."""


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


class VibrationState(NamedTuple):
    """The interval that is being filled, and the variance within the one before it."""

    interval: int = -1
    samples: tuple[tuple[float, float, float], ...] = ()
    variance: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    """[(m/s²)²], NaN where unknown."""


def vibration_of(stamp: IntArray, acceleration: FloatArray, origin: int) -> FloatArray:
    """Return the (n, 3) variance within the newest full interval before each sample.

    Intervals of one second count from `origin` [ns]; NaN until one is full, and where it held
    too few samples. The last sample of an interval still has the variance of the interval before.
    """
    interval = (stamp - origin) // VIBRATION_INTERVAL_NS
    starts = np.flatnonzero(np.diff(interval, prepend=interval[0] - 1))
    edges = np.append(starts, len(stamp)).astype(np.int64)
    mean, _ = bin_means(acceleration, edges)
    variance = bin_variances(acceleration, edges, mean)
    variance[np.diff(edges) < LEAST_SAMPLES] = np.nan
    before = np.vstack([np.full((1, 3), np.nan), variance[:-1]])
    held: FloatArray = np.repeat(before, np.diff(edges), axis=0)
    return held


def update_vibration(
    state: VibrationState, stamp: int, acceleration: tuple[float, float, float], origin: int
) -> VibrationState:
    """Return the state after one more sample; its `variance` is the sample's vibration."""
    interval = (stamp - origin) // VIBRATION_INTERVAL_NS
    if interval == state.interval:
        return state._replace(samples=(*state.samples, acceleration))
    variance = (np.nan, np.nan, np.nan)
    if len(state.samples) >= LEAST_SAMPLES:
        edges = np.array([0, len(state.samples)])
        samples = np.array(state.samples)
        variance = tuple(bin_variances(samples, edges, bin_means(samples, edges)[0])[0].tolist())
    return VibrationState(interval=interval, samples=(acceleration,), variance=variance)
