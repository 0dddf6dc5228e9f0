# SPDX-License-Identifier: Apache-2.0
"""What was measured, as plain values: recordings, plan, Tables III–V, one cycle, overheating."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from imu_recording.logging_contract import OPTIONAL_FIELDS
from imu_recording.recording import PHASES, SENSOR_FIELDS, FloatArray, ImuRecording
from numpy.typing import NDArray
from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS

from imu_workbench.report.series import hole_hours, hours, line
from imu_workbench.tables import paper

PLAN_TRACKS = {
    'setpoint': 'set-point',
    'chamber_temperature': 'chamber air',
    'device_temperature': 'thermocouple on the device',
    'temperature': 'die',
}
"""Tracks of the plan's figure and what they are called there."""
PAPER_TABLES = {'III': ('DUT1', 'x'), 'IV': ('DUT2', 'y'), 'V': ('DUT3', 'z')}


def recording_content(recording: ImuRecording, digest: str) -> dict[str, Any]:
    """Return what identifies a recording and how much of it there is."""
    period = np.diff(recording.stamp) * 1e-9
    temperature = recording.temperature[np.isfinite(recording.temperature)]
    field = np.isfinite(recording.magnetic_field).all(axis=1)
    return {
        'device': recording.device,
        'run': recording.run,
        'up_axis': recording.up_axis,
        'profile': recording.profile,
        'namespace': recording.namespace,
        'samples': len(recording),
        'duration_s': float(recording.time[-1]) if len(recording) else 0.0,
        'rate_hz': float(1.0 / np.median(period)) if len(period) else None,
        'longest_gap_s': float(period.max()) if len(period) else None,
        'temperature_range': [temperature.min(), temperature.max()] if len(temperature) else None,
        'magnetometer_samples': int(field.sum()),
        'tracks': [name for name in OPTIONAL_FIELDS if getattr(recording, name) is not None],
        'sha256': digest,
        'notes': list(recording.notes),
        'unplaced': dict(recording.unplaced),
    }


def plan_content(recording: ImuRecording, *, points: int) -> dict[str, Any] | None:
    """Return the temperatures over the run and the spans of its phases (Fig. 1)."""
    tracks = {
        label: line(hours(recording), values, points=points, max_gap=hole_hours(recording))
        for name, label in PLAN_TRACKS.items()
        if (values := getattr(recording, name)) is not None and np.isfinite(values).any()
    }
    if not tracks:
        return None
    return {
        'unit': '°C',
        'tracks': tracks,
        'phases': phase_spans(recording),
        'duration_h': float(recording.time[-1] / 3600.0),
        'paper_duration_h': 12.0,
        'cycles': int(recording.cycle.max()) if recording.cycle is not None else None,
    }


def phase_spans(recording: ImuRecording) -> list[dict[str, Any]]:
    """Return phase, cycle, first and last hour of every leg of the run."""
    if recording.phase is None:
        return []
    cycle = np.zeros(len(recording), int) if recording.cycle is None else recording.cycle
    legs = recording.phase * 1000 + cycle
    starts = [0, *(np.flatnonzero(np.diff(legs)) + 1).tolist(), len(recording) - 1]
    time = hours(recording)
    return [
        {
            'phase': PHASES[recording.phase[first]],
            'cycle': int(cycle[first]),
            'from_h': float(time[first]),
            'to_h': float(time[last]),
        }
        for first, last in pairwise(starts)
        if recording.phase[first] >= 0 and last > first
    ]


def statistics_content(
    recording: ImuRecording, kept: NDArray[np.bool_]
) -> dict[str, dict[str, Any]]:
    """Return Tables III–V of a run per sensor, over the `kept` rows, with ranges beside them."""
    everything = segment_statistics(recording)
    tables = segment_statistics(recording, kept)
    return {
        sensor: {
            'unit': DISPLAY_UNITS[sensor].unit,
            'rows': _rows(tables[sensor], DISPLAY_UNITS[sensor].factor),
            'largest_range': largest_range(tables, sensor) * DISPLAY_UNITS[sensor].factor,
            'largest_range_with_start_up': (
                largest_range(everything, sensor) * DISPLAY_UNITS[sensor].factor
            ),
        }
        for sensor in SENSORS
        if tables[sensor]
    }


def published_statistics() -> dict[str, dict[str, Any]]:
    """Return the paper's Tables III–V in the same shape, by table."""
    tables: dict[str, dict[str, Any]] = {}
    for name, (device, up) in PAPER_TABLES.items():
        rows = [row for row in paper.tables_3_4_5() if row['table'] == name]
        sensors = {
            sensor: {
                'unit': DISPLAY_UNITS[sensor].unit,
                'rows': [
                    {key: row[key] for key in ('axis', 'segment', 'min', 'max', 'mean', 'std')}
                    for row in rows
                    if row['quantity'].startswith(sensor)
                ],
            }
            for sensor in SENSORS
        }
        tables[name] = {'device': device, 'up': up, 'sensors': sensors}
    return tables


def cycle_content(recording: ImuRecording, *, points: int) -> dict[str, Any] | None:
    """Return one cycle of every channel as deviation from its mean, with temperature (Fig. 4)."""
    number, rows = _one_cycle(recording)
    if not rows.any() or not np.isfinite(recording.temperature[rows]).any():
        return None
    part = recording.rows(rows)
    minutes, gap = part.time / 60.0, hole_hours(part) * 60.0
    sensors = {}
    for sensor in SENSORS:
        values = DISPLAY_UNITS[sensor].of(getattr(part, SENSOR_FIELDS[sensor]))
        if np.isfinite(values).all(axis=1).any():
            means = np.nanmean(np.where(np.isfinite(values), values, np.nan), axis=0)
            smooth = [_smoothed(part.time, values[:, i] - means[i]) for i in range(3)]
            sensors[sensor] = {
                'unit': DISPLAY_UNITS[sensor].unit,
                'mean': means,
                'axes': {
                    axis: line(minutes, values[:, i] - means[i], points=points, max_gap=gap)
                    for i, axis in enumerate('xyz')
                },
                'means_20_s': {
                    axis: line(time / 60.0, mean, points=points, max_gap=gap)
                    for axis, (time, mean) in zip('xyz', smooth, strict=True)
                },
            }
    if not sensors:
        return None
    temperature = line(minutes, part.temperature, points=points, max_gap=gap)
    return {'cycle': number, 'sensors': sensors, 'temperature': temperature}


def overheating_content(recording: ImuRecording) -> dict[str, Any] | None:
    """Return how much warmer device and die are than the chamber's air while it dwells [K]."""
    air = recording.chamber_temperature
    if air is None or recording.phase is None:
        return None
    calm = np.isin(recording.phase, [PHASES.index(p) for p in PHASES if p.startswith('dwell')])
    found: dict[str, Any] = {}
    for label, track in (
        ('thermocouple', recording.device_temperature), ('die', recording.temperature)
    ):  # fmt: skip
        if track is not None:
            difference = (track - air)[calm]
            difference = difference[np.isfinite(difference)]
            if len(difference):
                found[label] = {'mean_k': difference.mean(), 'std_k': difference.std()}
    return found or None


def overall_ranges(statistics: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the largest range of any channel beside the one the paper states."""
    ranges: dict[str, dict[str, Any]] = {}
    for sensor in SENSORS:
        tables = [run['sensors'][sensor] for run in statistics if sensor in run['sensors']]
        if tables:
            ranges[sensor] = {
                'unit': DISPLAY_UNITS[sensor].unit,
                'paper': paper.OVERALL_RANGES[sensor],
                'without_start_up': max(table['largest_range'] for table in tables),
                'with_start_up': max(table['largest_range_with_start_up'] for table in tables),
            }
    return ranges


def _rows(tables: Sequence[SegmentStatistics], factor: float) -> list[dict[str, Any]]:
    return [
        {
            'axis': axis,
            'segment': table.segment,
            'samples': table.samples,
            'min': table.minimum[i] * factor,
            'max': table.maximum[i] * factor,
            'mean': table.mean[i] * factor,
            'std': table.std[i] * factor,
        }
        for i, axis in enumerate('xyz')
        for table in tables
    ]


def _one_cycle(recording: ImuRecording) -> tuple[int, NDArray[np.bool_]]:
    """Return the second cycle (the first one carries the warm-up), or what there is."""
    if recording.cycle is None or not (recording.cycle > 0).any():
        return 0, np.ones(len(recording), dtype=bool)
    numbers = np.unique(recording.cycle[recording.cycle > 0])
    number = int(numbers[min(1, len(numbers) - 1)])
    return number, recording.cycle == number


def _smoothed(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the means over 20 s and their times [s]."""
    finite = np.isfinite(values)
    place = (time[finite] // 20.0).astype(np.int64)
    count = np.bincount(place)
    filled = count > 0
    sums = np.bincount(place, weights=values[finite])
    middle = np.asarray((np.flatnonzero(filled) + 0.5) * 20.0, dtype=np.float64)
    return middle, sums[filled] / count[filled]


REFERENCE_SEGMENT = 'reference'
"""The quiet zone: the preconditioning at ambient temperature."""
WHOLE_RUN = 'whole run'
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
            rows[REFERENCE_SEGMENT] = quiet
    if recording.cycle is not None:
        for number in np.unique(recording.cycle[recording.cycle > 0]):
            rows[f'R{number}'] = recording.cycle == number
    return rows or {WHOLE_RUN: np.ones(len(recording), dtype=bool)}


def segment_statistics(
    recording: ImuRecording, kept: NDArray[np.bool_] | None = None
) -> dict[str, list[SegmentStatistics]]:
    """Return the statistics per sensor and segment, over the `kept` rows (None: all).

    Samples that are not finite do not count; a segment without samples of a sensor is left out.
    """
    places = {
        segment: _as_slice(rows if kept is None else rows & kept)
        for segment, rows in segment_rows(recording).items()
    }
    tables: dict[str, list[SegmentStatistics]] = {}
    for sensor, name in SENSOR_FIELDS.items():
        values = getattr(recording, name)
        found = (_statistics(segment, values[place]) for segment, place in places.items())
        tables[sensor] = [statistics for statistics in found if statistics]
    return tables


def _as_slice(rows: NDArray[np.bool_]) -> NDArray[np.bool_] | slice:
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
        segment=segment,
        samples=count,
        minimum=columns.min(axis=1),
        maximum=columns.max(axis=1),
        mean=columns.mean(axis=1),
        std=spread,
    )
