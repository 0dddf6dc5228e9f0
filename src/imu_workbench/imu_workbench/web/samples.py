# SPDX-License-Identifier: Apache-2.0
"""Samples of stored bags for a line on the screen, decimated anew for every zoom."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from imu_recording.recording import FloatArray

from imu_workbench.decimate import decimated
from imu_workbench.web.stored_bag import StoredBag

POINTS = 2400
"""Points of one line on the whole width."""
OVERVIEWS = 512
"""Lines over whole bags that are remembered."""


def sample_line(
    bag: StoredBag, sensor: str, axis: int, window: tuple[float, float], points: int = POINTS
) -> tuple[FloatArray, FloatArray]:
    """Return time since the first sample [s] and values [SI unit] within a window [s]."""
    return _line(bag, sensor, axis, window, points)


def temperature_line(
    bag: StoredBag, window: tuple[float, float], points: int = POINTS // 4
) -> tuple[FloatArray, FloatArray]:
    """Return time since the first sample [s] and die temperature [°C] within a window [s]."""
    return _line(bag, 'temperature', 0, window, points)


def _line(
    bag: StoredBag, column: str, axis: int, window: tuple[float, float], points: int
) -> tuple[FloatArray, FloatArray]:
    if window[0] <= 0.0 and window[1] >= bag.duration:
        return _overview(bag, column, axis, points)
    stamp = bag.stamp()
    edges = np.array(window) * 1e9 + stamp[0]
    first, last = np.searchsorted(stamp, edges.astype(np.int64))
    return _drawn(bag, column, axis, slice(max(int(first) - 1, 0), int(last) + 1), points)


@lru_cache(maxsize=OVERVIEWS)
def _overview(
    bag: StoredBag, column: str, axis: int, points: int
) -> tuple[FloatArray, FloatArray]:
    return _drawn(bag, column, axis, slice(0, None), points)


def _drawn(
    bag: StoredBag, column: str, axis: int, rows: slice, points: int
) -> tuple[FloatArray, FloatArray]:
    stamp = bag.stamp()
    if not len(stamp):
        return np.empty(0), np.empty(0)
    part = bag.temperature() if column == 'temperature' else bag.measured(column)[:, axis]
    values = np.ascontiguousarray(part[rows], dtype=np.float64)
    time = (stamp[rows] - stamp[0]) * 1e-9
    period = bag.duration / max(bag.samples - 1, 1)
    return decimated(time, values, max(points, 16), max(60.0, 5.0 * period))
