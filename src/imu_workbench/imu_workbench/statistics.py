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
    tables: dict[str, list[SegmentStatistics]] = {}
    for sensor, name in SENSOR_FIELDS.items():
        values = getattr(recording, name)
        found = (
            _statistics(segment, values[rows if kept is None else rows & kept])
            for segment, rows in segment_rows(recording).items()
        )
        tables[sensor] = [statistics for statistics in found if statistics]
    return tables


def largest_range(tables: dict[str, list[SegmentStatistics]], sensor: str) -> float:
    """Return the largest maximum − minimum of any axis in any segment, NaN where there is none."""
    ranges = [np.max(row.maximum - row.minimum) for row in tables[sensor]]
    return float(max(ranges, default=np.nan))


def _statistics(segment: str, values: FloatArray) -> SegmentStatistics | None:
    values = values[np.isfinite(values).all(axis=1)]
    if not len(values):
        return None
    spread = values.std(axis=0, ddof=1) if len(values) > 1 else np.full(3, np.nan)
    return SegmentStatistics(
        segment, len(values), values.min(axis=0), values.max(axis=0), values.mean(axis=0), spread
    )
