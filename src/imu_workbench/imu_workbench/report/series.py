# SPDX-License-Identifier: Apache-2.0
"""Lines of a figure: decimated without losing an extreme, as plain lists of numbers."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording, IntArray

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


def extreme_rows(values: FloatArray, points: int) -> IntArray:
    """Return at most `points` increasing rows of `values` (n,) that keep every bin's extremes.

    The rows are cut into points / 2 bins of equal count; each gives its smallest and its largest
    value. Values that are not finite are never chosen.
    """
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) <= points:
        return finite.astype(np.int64)
    chosen = values if len(finite) == len(values) else values[finite]
    rows = finite[_extremes(np.ascontiguousarray(chosen), points - points % 2)]
    return rows.astype(np.int64)


def _extremes(values: FloatArray, points: int) -> IntArray:
    try:
        from tsdownsample import MinMaxDownsampler
    except ImportError:
        return binned_extremes(values, points)
    # tsdownsample returns a bin's smallest and largest in order of time; both may be one row.
    return np.unique(MinMaxDownsampler().downsample(values, n_out=points).astype(np.int64))


def binned_extremes(values: FloatArray, points: int) -> IntArray:
    """Return the rows of each bin's extremes without tsdownsample; `values` are finite."""
    edges = np.linspace(0, len(values), points // 2 + 1).astype(np.int64)
    rows = []
    for first, last in pairwise(edges.tolist()):
        part = values[first:last]
        rows += [first + int(part.argmin()), first + int(part.argmax())]
    return np.unique(np.asarray(rows, dtype=np.int64))


def decimated(
    time: FloatArray, values: FloatArray, points: int = 2000, max_gap: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return time and values (n,) of at most about `points` rows for a line.

    Between rows further apart than `max_gap` seconds (in `time`'s own samples) a NaN breaks the
    line, so that a hole in the recording stays a hole.
    """
    rows = extreme_rows(values, points)
    kept_time, kept = time[rows], values[rows]
    if max_gap is None or len(rows) < 2:
        return kept_time, kept
    finite_time = time[np.isfinite(values)]
    holes = np.flatnonzero(np.diff(finite_time) > max_gap)
    places = np.unique(np.searchsorted(kept_time, finite_time[holes], side='right'))
    places = places[(places > 0) & (places < len(kept_time))]
    middle = (kept_time[places - 1] + kept_time[places]) / 2
    return np.insert(kept_time, places, middle), np.insert(kept, places, np.nan)
