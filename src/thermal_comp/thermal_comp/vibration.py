# SPDX-License-Identifier: Apache-2.0
"""Vibration as known in the field: variance of acceleration within the last full second."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.binning import bin_means, bin_variances

INTERVAL_NS = 1_000_000_000
"""Length of the interval [ns]."""
SMALLEST_COUNT = 45
"""Fewer samples in an interval (below about 50 Hz) tell no vibration."""


class VibrationState(NamedTuple):
    """The interval that is being filled and the variance of the newest full one."""

    interval: int = -1
    samples: tuple[tuple[float, float, float], ...] = ()
    variance: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    """[(m/s²)²], NaN where unknown."""


def vibration_of(stamp: IntArray, acceleration: FloatArray, origin: int) -> FloatArray:
    """Return the (n, 3) variance within the newest full interval before each sample.

    Intervals of one second count from `origin` [ns]; NaN until one is full, and where it held
    too few samples. The last sample of an interval still sees the interval before.
    """
    interval = (stamp - origin) // INTERVAL_NS
    starts = np.flatnonzero(np.diff(interval, prepend=interval[0] - 1))
    edges = np.append(starts, len(stamp)).astype(np.int64)
    mean, _ = bin_means(acceleration, edges)
    variance = bin_variances(acceleration, edges, mean)
    variance[np.diff(edges) < SMALLEST_COUNT] = np.nan
    before = np.vstack([np.full((1, 3), np.nan), variance[:-1]])
    held: FloatArray = np.repeat(before, np.diff(edges), axis=0)
    return held


def update_vibration(
    state: VibrationState, stamp: int, acceleration: tuple[float, float, float], origin: int
) -> VibrationState:
    """Return the state after one more sample; its `variance` is the sample's vibration."""
    interval = (stamp - origin) // INTERVAL_NS
    if interval == state.interval:
        return state._replace(samples=(*state.samples, acceleration))
    variance = (np.nan, np.nan, np.nan)
    if len(state.samples) >= SMALLEST_COUNT:
        edges = np.array([0, len(state.samples)])
        samples = np.array(state.samples)
        variance = tuple(bin_variances(samples, edges, bin_means(samples, edges)[0])[0].tolist())
    return VibrationState(interval, (acceleration,), variance)
