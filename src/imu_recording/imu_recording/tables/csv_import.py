# SPDX-License-Identifier: Apache-2.0
"""A CSV file of measurements as a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from imu_recording.held_temperature import note_held
from imu_recording.logging_contract import MEASURED_FIELDS
from imu_recording.phase import phases_from_setpoint
from imu_recording.recording import BagError, FloatArray, ImuRecording, IntArray, infer_up_axis
from imu_recording.synchronise import (
    CLOCK_SET_BACK,
    Samples,
    hold_newest,
    in_order,
    interpolate,
    join_next,
    without_jumps,
)
from imu_recording.tables.csv_table import ALL_ROWS, read_table
from imu_recording.tables.mapping import (
    ISO_TIME,
    TIME_UNITS,
    VECTOR_FIELDS,
    CsvMapping,
    load_mapping,
    mapping_from,
)
from imu_recording.tables.row_range import RowRange

LARGEST_SPARSE_SHARE = 0.5
"""Share of rows with a value of a channel, up to which the others are empty cells between."""
HELD_PERIODS = 10.0
"""Periods of a file beside another for which its values are held."""
EARLIEST_DATE_NS = 10**17
"""Stamps below it count from power-on, not from 1970 [ns]."""
LATEST_STAMP_NS = 9.2e18
"""Stamps are int64 nanoseconds."""


MappingLike = str | PathLike[str] | Mapping[str, Any] | CsvMapping


def import_csv(
    csv_path: str | PathLike[str],
    mapping: MappingLike,
    rows: RowRange = ALL_ROWS,
    *,
    beside: Sequence[tuple[str | PathLike[str], MappingLike]] = (),
) -> ImuRecording:
    """Read a CSV file, or some of its rows, as the mapping (a file, its content …) tells.

    Rows are sorted by time; rows without a time and repeated times are left out, values that are
    missing or not finite are NaN, gaps are counted: all of it said in `notes`. Channels of the
    files `beside` it come onto its rows by their time. Raises BagError naming line and column,
    MappingError naming the key.
    """
    path = Path(csv_path)
    checked = _mapping(mapping)
    samples, names, notes = _read(path, checked, rows)
    inside = rows.within(samples.stamp)
    if not inside.any():
        raise BagError(f'{path}: no row between --from and --to')
    if not inside.all():
        notes.append(f'{int((~inside).sum())} rows outside --from and --to left out')
    samples = Samples(samples.stamp[inside], tuple(v[inside] for v in samples.values))
    found: dict[str, Any] = dict(zip(names, samples.values, strict=True))
    _note_gaps(samples.stamp, notes)
    for field in [name for name in found if name not in VECTOR_FIELDS]:
        _hold_sparse(samples.stamp, field, found, notes)
    for field, values in found.items():
        if field != 'temperature_stamp':
            _note_missing(field, values, notes)
    for other, its in beside:
        joined = _joined(Path(other), _mapping(its, beside=True), samples.stamp, notes)
        for field in joined:
            if field in found:
                raise BagError(f'{field} is in {other} and in another file: map it in one only')
        found |= joined
    return _recording(path, checked, samples.stamp, found, notes)


def _read(path: Path, mapping: CsvMapping, rows: RowRange) -> tuple[Samples, list[str], list[str]]:
    """Return the samples of a file, the field of each of their groups, and notes."""
    names = [mapping.time_column, *(column.column for column in mapping.columns)]
    table, notes = read_table(path, mapping, names, rows)
    if rows.by_line and not len(table):
        raise BagError(f'{path}: no row between --from and --to')
    stamp, kept = _stamps(path, table[:, 0], mapping, notes)
    fields = fields_of(mapping, table[kept])
    samples = without_jumps('rows', in_order('rows', stamp, tuple(fields.values())))
    if len(stamp) > 1 and len(samples.stamp) == 1 and not np.ptp(stamp):
        raise BagError(
            f'{path}: {mapping.clock} holds the same time in all '
            f'{len(stamp)} rows; is it the time? (time: column in the mapping)'
        )
    if rows.by_line:
        notes.append('rows before --from and after --to were not read')
    clock_notes = [
        f'{note}; another --from or --to takes those' if CLOCK_SET_BACK in note else note
        for note in samples.notes
    ]
    return samples, list(fields), [*notes, *clock_notes]


def _joined(
    path: Path, mapping: CsvMapping, rows: IntArray, notes: list[str]
) -> dict[str, FloatArray | IntArray]:
    """Return the channels of a further file on the rows (n,) [ns], by field.

    Vectors of accelerometer and gyroscope are interpolated, the others are held for ten of their
    own periods at most.
    """
    samples, names, own_notes = _read(path, mapping, ALL_ROWS)
    notes += [f'{path.name}: {note}' for note in own_notes]
    _refuse_apart(path, rows, samples.stamp)
    since = (samples.stamp[0] - rows[0]) * 1e-9
    notes.append(
        f'{path.name}: {len(samples.stamp)} samples joined by time, the first '
        f'{abs(since):.3f} s {"after" if since > 0.0 else "before"} the first row '
        f'(offset {mapping.time_offset:.3f} s)'
    )
    stale = int(HELD_PERIODS * np.median(np.diff(samples.stamp))) if len(samples.stamp) > 1 else 0
    found: dict[str, FloatArray | IntArray] = {}
    for field, values in zip(names, samples.values, strict=True):
        name = f'{path.name}, {field}'
        own = Samples(samples.stamp, (values, samples.stamp[:, None]))
        if field == 'magnetic_field':
            found[field] = join_next(name, rows, own).values[0]
            continue
        if field in MEASURED_FIELDS:
            found[field], _ = interpolate(rows, own)
            continue
        held, measured = hold_newest(name, rows, own, event=True).values
        old = (measured[:, 0] < 0) | (rows - measured[:, 0] > stale)
        held = np.where(old[:, None], np.nan, held)
        if old.any():
            notes.append(f'{name}: {int(old.sum())} rows without a sample of the time, NaN')
        found[field] = held
        if field == 'temperature':
            found['temperature_stamp'] = np.where(old, -1, measured[:, 0])
    return found


def _refuse_apart(path: Path, rows: IntArray, stamp: IntArray) -> None:
    if stamp[0] <= rows[-1] and stamp[-1] >= rows[0]:
        return
    raise BagError(
        f'{path}: its times, {_moment(stamp[0])} to {_moment(stamp[-1])}, are not those of the '
        f'first file, {_moment(rows[0])} to {_moment(rows[-1])}; say the difference in its '
        'mapping (time: zone: +01:00 of dates, start: DATE of a clock that counts, or offset: '
        'SECONDS)'
    )


def _moment(stamp: int) -> str:
    """Return a stamp [ns] as a date, or as seconds where it is near zero."""
    if stamp < EARLIEST_DATE_NS:
        return f'{stamp * 1e-9:.3f} s'
    return datetime.fromtimestamp(stamp * 1e-9, UTC).isoformat(timespec='seconds')


def _mapping(mapping: MappingLike, *, beside: bool = False) -> CsvMapping:
    if isinstance(mapping, CsvMapping):
        return mapping
    if isinstance(mapping, Mapping):
        return mapping_from(mapping, beside=beside)
    return load_mapping(Path(mapping), beside=beside)


def _stamps(
    path: Path, time: FloatArray, mapping: CsvMapping, notes: list[str]
) -> tuple[IntArray, Any]:
    kept = np.isfinite(time)
    lost = len(time) - int(kept.sum())
    if lost:
        notes.append(f'{lost} rows without a time left out')
    if not kept.any():
        raise BagError(f'{path}: no row with a time in {mapping.clock}')
    unit = 1e9 if mapping.time_unit == ISO_TIME else TIME_UNITS[mapping.time_unit]
    taken = time[kept]
    worst = float(np.abs(taken).max())
    if worst * unit + abs(mapping.time_offset) * 1e9 > LATEST_STAMP_NS:
        raise BagError(
            f'{path}, {mapping.clock}: {worst:g} {mapping.time_unit} is no time; '
            'is its unit right?'
        )
    whole = np.floor(taken)
    stamp = whole.astype(np.int64) * int(unit) + np.rint((taken - whole) * unit).astype(np.int64)
    return stamp + round(mapping.time_offset * 1e9), kept


def fields_of(mapping: CsvMapping, table: FloatArray) -> dict[str, FloatArray]:
    """Return (n, k) of each field in its unit; `table`: (n, 1 + columns), the time first."""
    fields: dict[str, FloatArray] = {}
    for place, column in enumerate(mapping.columns, start=1):
        width = 3 if column.field in VECTOR_FIELDS else 1
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


def _hold_sparse(stamp: IntArray, field: str, found: dict[str, Any], notes: list[str]) -> None:
    """Hold a value that stands in few rows until the next one, for ten of its periods at most.

    A logger that reads a thermometer once a second leaves the cells of most rows empty.
    """
    values = found[field]
    known = np.isfinite(values[:, 0])
    places = np.flatnonzero(known)
    if len(places) < 2 or len(places) > LARGEST_SPARSE_SHARE * len(stamp):
        return
    newest = np.maximum.accumulate(np.where(known, np.arange(len(stamp)), -1))
    stale = HELD_PERIODS * np.median(np.diff(stamp[places]))
    old = (newest < 0) | (stamp - stamp[newest] > stale)
    found[field] = np.where(old[:, None], np.nan, values[newest])
    if field == 'temperature':
        found['temperature_stamp'] = np.where(old, -1, stamp[newest])
    notes.append(f'{field}: {len(places)} of {len(stamp)} rows hold a value, each until the next')


def _note_missing(field: str, values: FloatArray, notes: list[str]) -> None:
    missing = ~np.isfinite(values)
    if missing.any():
        values[missing] = np.nan
        rows = int(missing.any(axis=1).sum())
        notes.append(f'{field}: {rows} of {len(values)} rows are missing or not finite, NaN')


def _recording(
    path: Path, mapping: CsvMapping, stamp: IntArray, found: dict[str, Any], notes: list[str]
) -> ImuRecording:
    n = len(stamp)
    for field in MEASURED_FIELDS:
        if field not in found:
            found[field] = np.full((n, 3), np.nan)
            notes.append(f'no columns for {field}: it is NaN')
    if 'temperature' not in found:
        found['temperature'] = np.full((n, 1), np.nan)
        notes.append('no column for temperature: it is NaN')
    measured = found.pop('temperature_stamp', stamp)
    tracks: dict[str, Any] = {
        k: v if k in VECTOR_FIELDS else np.ascontiguousarray(v[:, 0]) for k, v in found.items()
    }
    held = note_held(measured, tracks['temperature'], notes)
    if held is not None or measured is not stamp:
        tracks['temperature_stamp'] = measured if held is None else held
    if 'setpoint' in tracks:
        time = (stamp - stamp[0]) * 1e-9
        tracks['phase'], tracks['cycle'] = phases_from_setpoint(time, tracks['setpoint'])
        notes.append('phase and cycle are derived from the set-point')
    up_axis = mapping.up_axis
    if not up_axis:
        up_axis = infer_up_axis(tracks['linear_acceleration'])
        if up_axis:
            notes.append(f'up_axis {up_axis} is inferred from gravity')
    return ImuRecording(
        stamp=stamp,
        **tracks,
        frame_id=mapping.frame_id,
        device=mapping.device,
        run=mapping.run,
        up_axis=up_axis,
        profile=mapping.profile,
        source=str(path),
        notes=tuple(notes),
    )
