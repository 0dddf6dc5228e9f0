# SPDX-License-Identifier: Apache-2.0
"""A CSV file of measurements as a recording."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from imu_recording.held_temperature import note_held
from imu_recording.phase import phases_from_setpoint
from imu_recording.recording import BagError, FloatArray, ImuRecording, IntArray, infer_up_axis
from imu_recording.synchronise import Samples, in_order, without_jumps
from imu_recording.tables.mapping import (
    ISO_TIME,
    TIME_UNITS,
    VECTORS,
    CsvMapping,
    load_mapping,
    mapping_from,
)
from imu_recording.tables.row_range import RowRange
from imu_recording.user_error import did_you_mean

ALL_ROWS = RowRange()
LATEST_STAMP = 9.2e18
"""Stamps are int64 nanoseconds."""


def import_csv(
    csv_path: str | PathLike[str],
    mapping: str | PathLike[str] | Mapping[str, Any] | CsvMapping,
    rows: RowRange = ALL_ROWS,
) -> ImuRecording:
    """Read a CSV file, or some of its rows, as the mapping (a file, its content …) tells.

    Rows are sorted by time; rows without a time and repeated times are left out, values that are
    missing or not finite are NaN, gaps are counted: all of it said in `notes`. Raises BagError
    naming line and column, MappingError naming the key.
    """
    path = Path(csv_path)
    told = _mapping(mapping)
    names = [told.time_column, *(column.column for column in told.columns)]
    table, notes = read_table(path, told, names, rows)
    if rows.by_line and not len(table):
        raise BagError(f'{path}: no row between --from and --to')
    stamp, kept = _stamps(path, table[:, 0], told, notes)
    fields = _fields(told, table[kept])
    samples = without_jumps('rows', in_order('rows', stamp, tuple(fields.values())))
    notes += samples.notes
    inside = rows.within(samples.stamp)
    if not inside.any():
        raise BagError(f'{path}: no row between --from and --to')
    if not inside.all():
        notes.append(f'{int((~inside).sum())} rows outside --from and --to left out')
    samples = Samples(samples.stamp[inside], tuple(v[inside] for v in samples.values))
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
    if worst * unit > LATEST_STAMP:
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
        temperature_stamp=note_held(stamp, tracks['temperature'], notes),
        frame_id=told.frame_id,
        device=told.device,
        run=told.run,
        up_axis=up_axis,
        profile=told.profile,
        source=str(path),
        notes=tuple(notes),
    )


MISSING = frozenset({'', 'nan', 'na', 'n/a', 'null', 'none', '-'})
"""What a cell without a value may hold, in lower case."""
_INFINITE = frozenset({'inf', '+inf', '-inf', 'infinity', '-infinity'})


def read_table(
    path: Path, mapping: CsvMapping, names: Sequence[str], rows: RowRange = ALL_ROWS
) -> tuple[FloatArray, list[str]]:
    """Return the named columns as (n, len(names)) and notes; raise BagError naming the place.

    Cells without a value are NaN; lines with another number of cells are left out and counted.
    Dates become seconds since 1970 (UTC where they name no zone, which is said).
    """
    try:
        try:
            with path.open(encoding='utf-8-sig', newline='') as stream:
                return _parse(stream, path, mapping, names, rows)
        except UnicodeDecodeError:
            with path.open(encoding='cp1252', errors='replace', newline='') as stream:
                table, notes = _parse(stream, path, mapping, names, rows)
            return table, [*notes, 'the file is not UTF-8: read as Windows-1252 (cp1252)']
    except OSError as error:
        raise BagError(f'{path}: cannot be read ({error.strerror})') from None
    except csv.Error as error:
        raise BagError(f'{path}: not a CSV file ({error})') from None


def _parse(
    stream: Iterator[str],
    path: Path,
    mapping: CsvMapping,
    names: Sequence[str],
    rows: RowRange,
) -> tuple[FloatArray, list[str]]:
    lines = _lines(stream, mapping)
    first = next(lines, None)
    if first is None:
        raise BagError(f'{path}: the file is empty')
    number, header = first
    places = [_place(name, header, path, mapping) for name in names]
    width = len(header)
    values: list[list[float]] = []
    left_out: list[int] = []
    zoned = mapping.time_unit != ISO_TIME
    if not mapping.header and rows.has_line(number):
        values.append(_row(header, places, path, number, mapping, names))
    for number, cells in lines:
        if not rows.has_line(number):
            continue
        if len(cells) != width:
            left_out.append(number)
            continue
        values.append(_row(cells, places, path, number, mapping, names))
        zoned = zoned or _names_zone(cells[places[0][0]])
    notes = [] if zoned else ['the times name no zone: taken as UTC']
    if left_out:
        notes.append(
            f'{len(left_out)} lines do not have {width} cells and are left out '
            f'(first: line {left_out[0]})'
        )
    return np.array(values, float).reshape(len(values), len(names)), notes


def _lines(stream: Iterator[str], mapping: CsvMapping) -> Iterator[tuple[int, list[str]]]:
    """Give line number and cells of every line that is neither blank nor a comment."""
    reader = csv.reader(stream, delimiter=mapping.delimiter, skipinitialspace=True)
    for cells in reader:
        text = ''.join(cells).strip()
        if not text or (mapping.comment and text.startswith(mapping.comment)):
            continue
        yield reader.line_num, cells


def _place(name: str, header: list[str], path: Path, mapping: CsvMapping) -> tuple[int, float]:
    """Return the column's index and its sign."""
    known = [cell.strip() if mapping.header else str(k) for k, cell in enumerate(header)]
    for candidate, sign in ((name, 1.0), (name.removeprefix('-').strip(), -1.0)):
        if candidate in known:
            return known.index(candidate), sign
    others = [sign for sign in ';\t|,' if sign != mapping.delimiter]
    split = next((sign for sign in others if len(header) == 1 and sign in header[0]), '')
    way = f'; is the delimiter {split!r}? (delimiter: {split!r} in the mapping)' if split else ''
    raise BagError(
        f'{path}: no column {name!r}{did_you_mean(name, known)}; it has {", ".join(known)}{way}'
    )


def _row(
    cells: list[str],
    places: list[tuple[int, float]],
    path: Path,
    number: int,
    mapping: CsvMapping,
    names: Sequence[str],
) -> list[float]:
    try:
        if mapping.decimal == '.' and mapping.time_unit != ISO_TIME:
            return [sign * float(cells[at]) for at, sign in places]
    except ValueError:
        pass  # a cell without a value, or one to complain about: looked at below
    values = []
    for (at, sign), name in zip(places, names, strict=True):
        date = name == mapping.time_column and mapping.time_unit == ISO_TIME
        value = _date(cells[at]) if date else _value(cells[at], mapping.decimal)
        if value is None:
            raise BagError(
                f'{path}, line {number}, column {name!r}: {cells[at].strip()!r} is no '
                f'{_expected(cells[at], mapping, date=date)}'
            )
        values.append(sign * value)
    return values


def _expected(cell: str, mapping: CsvMapping, *, date: bool) -> str:
    """Return what a cell should be, and the setting that may make it so."""
    if date:
        return 'date; write dates as 2024-03-07T12:00:00 (ISO 8601)'
    if mapping.decimal == '.' and _value(cell, ',') is not None:
        return "number; is the decimal sign a comma? (decimal: ',' in the mapping)"
    return 'number'


def _value(cell: str, decimal: str) -> float | None:
    text = cell.strip().lower().replace(decimal, '.')
    if text in MISSING:
        return np.nan
    if text in _INFINITE:
        return float(text)
    try:
        return float(text)
    except ValueError:
        return None


def _names_zone(cell: str) -> bool:
    """Tell whether a date says which zone it is of: +01:00 or Z at its end."""
    return bool(re.search(r'(Z|[+-]\d\d:?\d\d)$', cell.strip()))


def _date(cell: str) -> float | None:
    text = cell.strip()
    if text.lower() in MISSING:
        return np.nan
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
