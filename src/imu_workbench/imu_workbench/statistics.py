# SPDX-License-Identifier: Apache-2.0
"""Tables III–V: minimum, maximum, mean and σ of every channel in the quiet zone and the cycles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imu_recording.recording import PHASES, SENSOR_FIELDS, FloatArray, ImuRecording
from numpy.typing import NDArray

REFERENCE = 'reference'
"""The quiet zone: the preconditioning at ambient temperature."""
WHOLE = 'whole run'
"""The only segment of a recording without phases and cycles."""


@dataclass(frozen=True, eq=False)
class SegmentStatistics:
    """Statistics of one sensor's three axes over one segment, in SI units."""

    segment: str
    samples: int
    minimum: FloatArray
    """(3,)"""
    maximum: FloatArray
    """(3,)"""
    mean: FloatArray
    """(3,)"""
    std: FloatArray
    """(3,) standard deviation, n − 1 in the denominator."""


def segment_rows(recording: ImuRecording) -> dict[str, NDArray[np.bool_]]:
    """Return the rows of each segment: the reference, then R1, R2 … one per cycle.

    A recording without phases and cycles is one segment.
    """
    rows: dict[str, NDArray[np.bool_]] = {}
    if recording.phase is not None:
        quiet = recording.phase == PHASES.index('precondition')
        if quiet.any():
            rows[REFERENCE] = quiet
    if recording.cycle is not None:
        for number in np.unique(recording.cycle[recording.cycle > 0]):
            rows[f'R{number}'] = recording.cycle == number
    return rows or {WHOLE: np.ones(len(recording), dtype=bool)}


def segment_statistics(
    recording: ImuRecording, kept: NDArray[np.bool_] | None = None
) -> dict[str, list[SegmentStatistics]]:
    """Return the statistics per sensor and segment, over the `kept` rows (None: all).

    Samples that are not finite do not count; a segment without samples of a sensor is left out.
    """
    places = {
        segment: _place(rows if kept is None else rows & kept)
        for segment, rows in segment_rows(recording).items()
    }
    tables: dict[str, list[SegmentStatistics]] = {}
    for sensor, name in SENSOR_FIELDS.items():
        values = getattr(recording, name)
        found = (_statistics(segment, values[place]) for segment, place in places.items())
        tables[sensor] = [statistics for statistics in found if statistics]
    return tables


def _place(rows: NDArray[np.bool_]) -> NDArray[np.bool_] | slice:
    """Return the rows as a slice where they are in one piece: nothing is copied then."""
    first, count = int(rows.argmax()), int(np.count_nonzero(rows))
    return slice(first, first + count) if rows[first : first + count].all() else rows


def largest_range(tables: dict[str, list[SegmentStatistics]], sensor: str) -> float:
    """Return the largest maximum − minimum of any axis in any segment, NaN where there is none."""
    ranges = [np.max(row.maximum - row.minimum) for row in tables[sensor]]
    return float(max(ranges, default=np.nan))


def _statistics(segment: str, values: FloatArray) -> SegmentStatistics | None:
    columns = np.ascontiguousarray(values.T)
    finite = np.isfinite(columns).all(axis=0)
    if not finite.all():
        columns = columns[:, finite]
    count = columns.shape[1]
    if not count:
        return None
    spread = columns.std(axis=1, ddof=1) if count > 1 else np.full(3, np.nan)
    return SegmentStatistics(
        segment, count, columns.min(axis=1), columns.max(axis=1), columns.mean(axis=1), spread
    )
