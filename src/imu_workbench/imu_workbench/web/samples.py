# SPDX-License-Identifier: Apache-2.0
"""Samples of stored bags for a line on the screen, decimated anew for every zoom."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray

from imu_workbench.decimate import decimated
from imu_workbench.web.stored_bag import StoredBag

POINTS = 2400
"""Points of one line on the whole width."""


def sample_line(
    bag: StoredBag, sensor: str, axis: int, window: tuple[float, float], points: int = POINTS
) -> tuple[FloatArray, FloatArray]:
    """Return time since the first sample [s] and values [SI unit] within a window [s]."""
    return _line(bag, bag.measured(sensor), axis, window, points)


def temperature_line(
    bag: StoredBag, window: tuple[float, float], points: int = POINTS // 4
) -> tuple[FloatArray, FloatArray]:
    """Return time since the first sample [s] and die temperature [°C] within a window [s]."""
    return _line(bag, bag.temperature(), None, window, points)


def _line(
    bag: StoredBag,
    column: FloatArray,
    axis: int | None,
    window: tuple[float, float],
    points: int,
) -> tuple[FloatArray, FloatArray]:
    stamp = bag.stamp()
    if not len(stamp):
        return np.empty(0), np.empty(0)
    edges = np.array(window) * 1e9 + stamp[0]
    first, last = np.searchsorted(stamp, edges.astype(np.int64))
    first, last = max(int(first) - 1, 0), min(int(last) + 1, len(stamp))
    part = column[first:last] if axis is None else column[first:last, axis]
    values = np.ascontiguousarray(part, dtype=np.float64)
    time = (stamp[first:last] - stamp[0]) * 1e-9
    period = bag.duration / max(bag.samples - 1, 1)
    return decimated(time, values, max(points, 16), max(60.0, 5.0 * period))
