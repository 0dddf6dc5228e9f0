# SPDX-License-Identifier: Apache-2.0
"""A CSV file of measurements as a recording."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from imu_recording.bag_error import BagError
from imu_recording.csv_mapping import CsvMapping, load_mapping, mapping_from
from imu_recording.csv_table import read_table
from imu_recording.csv_units import ISO_TIME, TIME_UNITS, VECTORS
from imu_recording.phase import phases_from_setpoint
from imu_recording.recording import FloatArray, ImuRecording, IntArray
from imu_recording.synchronise import in_order
from imu_recording.up_axis import infer_up_axis

LATEST_NS = 9.2e18
"""Stamps are int64 nanoseconds."""


def import_csv(
    csv_path: str | PathLike[str], mapping: str | PathLike[str] | Mapping[str, Any] | CsvMapping
) -> ImuRecording:
    """Read a CSV file as the mapping (a file, its content, or a CsvMapping) tells.

    Rows are sorted by time; rows without a time and repeated times are left out, values that are
    missing or not finite are NaN, gaps are counted: all of it said in `notes`. Raises BagError
    naming line and column, MappingError naming the key.
    """
    path = Path(csv_path)
    told = _mapping(mapping)
    names = [told.time_column, *(column.column for column in told.columns)]
    table, notes = read_table(path, told, names)
    stamp, kept = _stamps(path, table[:, 0], told, notes)
    fields = _fields(told, table[kept])
    samples = in_order('rows', stamp, tuple(fields.values()))
    notes += samples.notes
    found: dict[str, Any] = dict(zip(fields, samples.values, strict=True))
    _note_gaps(samples.stamp, notes)
    for field, values in found.items():
        _note_missing(field, values, notes)
    return _recording(path, told, samples.stamp, found, notes)


def _mapping(mapping: str | PathLike[str] | Mapping[str, Any] | CsvMapping) -> CsvMapping:
    if isinstance(mapping, CsvMapping):
        return mapping
    if isinstance(mapping, Mapping):
        return mapping_from(mapping)
    return load_mapping(Path(mapping))


def _stamps(
    path: Path, time: FloatArray, told: CsvMapping, notes: list[str]
) -> tuple[IntArray, Any]:
    kept = np.isfinite(time)
    lost = len(time) - int(kept.sum())
    if lost:
        notes.append(f'{lost} rows without a time left out')
    if not kept.any():
        raise BagError(f'{path}: no row with a time in column {told.time_column!r}')
    unit = 1e9 if told.time_unit == ISO_TIME else TIME_UNITS[told.time_unit]
    taken = time[kept]
    worst = float(np.abs(taken).max())
    if worst * unit > LATEST_NS:
        raise BagError(
            f'{path}, column {told.time_column!r}: {worst:g} {told.time_unit} is no time; '
            'is its unit right?'
        )
    whole = np.floor(taken)
    stamp = whole.astype(np.int64) * int(unit) + np.rint((taken - whole) * unit).astype(np.int64)
    return stamp, kept


def _fields(told: CsvMapping, table: FloatArray) -> dict[str, FloatArray]:
    fields: dict[str, FloatArray] = {}
    for place, column in enumerate(told.columns, start=1):
        width = 3 if column.field in VECTORS else 1
        values = fields.setdefault(column.field, np.empty((len(table), width)))
        values[:, column.axis] = table[:, place] * column.factor + column.offset
    return fields


def _note_gaps(stamp: IntArray, notes: list[str]) -> None:
    step = np.diff(stamp)
    if not len(step):
        return
    gaps = step[step > 3 * np.median(step)]
    if len(gaps):
        longest = float(gaps.max()) * 1e-9
        notes.append(f'{len(gaps)} gaps above three periods, the longest {longest:.3g} s')


def _note_missing(field: str, values: FloatArray, notes: list[str]) -> None:
    missing = ~np.isfinite(values)
    if missing.any():
        values[missing] = np.nan
        rows = int(missing.any(axis=1).sum())
        notes.append(f'{field}: {rows} of {len(values)} rows are missing or not finite, NaN')


def _recording(
    path: Path, told: CsvMapping, stamp: IntArray, found: dict[str, Any], notes: list[str]
) -> ImuRecording:
    n = len(stamp)
    for field in VECTORS:
        if field not in found:
            found[field] = np.full((n, 3), np.nan)
            notes.append(f'no columns for {field}: it is NaN')
    if 'temperature' not in found:
        found['temperature'] = np.full((n, 1), np.nan)
        notes.append('no column for temperature: it is NaN')
    tracks: dict[str, Any] = {
        k: v if k in VECTORS else np.ascontiguousarray(v[:, 0]) for k, v in found.items()
    }
    if 'setpoint' in tracks:
        time = (stamp - stamp[0]) * 1e-9
        tracks['phase'], tracks['cycle'] = phases_from_setpoint(time, tracks['setpoint'])
        notes.append('phase and cycle are derived from the set-point')
    up_axis = told.up_axis
    if not up_axis:
        up_axis = infer_up_axis(tracks['linear_acceleration'])
        if up_axis:
            notes.append(f'up_axis {up_axis} is inferred from gravity')
    return ImuRecording(
        stamp=stamp,
        **tracks,
        frame_id=told.frame_id,
        device=told.device,
        run=told.run,
        up_axis=up_axis,
        profile=told.profile,
        source=str(path),
        notes=tuple(notes),
    )
