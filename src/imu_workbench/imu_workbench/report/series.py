# SPDX-License-Identifier: Apache-2.0
"""Lines of a figure as plain lists: decimated without losing extremes, digits as can be seen."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording

from imu_workbench.decimate import decimated

Series = dict[str, list[float | None]]
"""{'x': […], 'y': […]}; None breaks the line."""


def line(x: FloatArray, y: FloatArray, *, points: int, max_gap: float | None = None) -> Series:
    """Return the line through y (n,) over x (n,), of at most about `points` points."""
    kept_x, kept_y = decimated(x, y, points, max_gap)
    return {'x': rounded(kept_x), 'y': rounded(kept_y)}


def rounded(values: FloatArray, digits: int = 5) -> list[float | None]:
    """Return values as a list with `digits` digits of their span; None where not finite.

    >>> rounded(np.array([9.80712345, 9.80798765, np.nan]))
    [9.80712345, 9.80798765, None]
    >>> rounded(np.array([0.0, 12.3456789]))
    [0.0, 12.346]
    """
    values = np.asarray(values, dtype=np.float64)
    finite = values[np.isfinite(values)]
    span = float(np.ptp(finite)) if len(finite) else 0.0
    if span > 0.0:
        values = np.round(values, digits - 1 - math.floor(math.log10(span)))
    items: list[Any] = values.tolist()
    if len(finite) < len(values):
        items = [item if math.isfinite(item) else None for item in items]
    return items


def hours(recording: ImuRecording) -> FloatArray:
    """Return the time since the first sample [h]."""
    return recording.time / 3600.0


def hole_hours(recording: ImuRecording) -> float:
    """Return the gap [h] above which a line is broken: three periods, a minute at the least."""
    if len(recording) < 2:
        return math.inf
    period = float(np.median(np.diff(recording.stamp))) * 1e-9
    return max(60.0, 3.0 * period) / 3600.0
