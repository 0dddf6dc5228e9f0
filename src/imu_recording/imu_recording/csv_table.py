# SPDX-License-Identifier: Apache-2.0
"""Chosen columns of a CSV file as numbers, with the place of what is wrong."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from imu_recording.bag_error import BagError
from imu_recording.csv_mapping import CsvMapping
from imu_recording.csv_units import ISO_TIME
from imu_recording.recording import FloatArray

MISSING = frozenset({'', 'nan', 'na', 'n/a', 'null', 'none', '-'})
"""What a cell without a value may hold, in lower case."""
_INFINITE = frozenset({'inf', '+inf', '-inf', 'infinity', '-infinity'})


def read_table(
    path: Path, mapping: CsvMapping, names: Sequence[str]
) -> tuple[FloatArray, list[str]]:
    """Return the named columns as (n, len(names)) and notes; raise BagError naming the place.

    Cells without a value are NaN; lines with another number of cells are left out and counted.
    Dates become seconds since 1970 (UTC where they name no zone).
    """
    try:
        with path.open(encoding='utf-8-sig', errors='replace', newline='') as stream:
            return _parse(stream, path, mapping, names)
    except OSError as error:
        raise BagError(f'{path}: cannot be read ({error.strerror})') from None
    except csv.Error as error:
        raise BagError(f'{path}: not a CSV file ({error})') from None


def _parse(
    stream: Iterator[str], path: Path, mapping: CsvMapping, names: Sequence[str]
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
    if not mapping.header:
        values.append(_row(header, places, path, number, mapping, names))
    for number, cells in lines:
        if len(cells) != width:
            left_out.append(number)
            continue
        values.append(_row(cells, places, path, number, mapping, names))
    notes = []
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
    raise BagError(f'{path}: no column {name!r}; it has {", ".join(known)}')


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
                f'{"date" if date else "number"}'
            )
        values.append(sign * value)
    return values


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


def _date(cell: str) -> float | None:
    text = cell.strip()
    if text.lower() in MISSING:
        return np.nan
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
