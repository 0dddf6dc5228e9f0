# SPDX-License-Identifier: Apache-2.0
"""The cells of a CSV file as numbers; what is no number is named with its line and column."""

from __future__ import annotations

import csv
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime, tzinfo
from itertools import chain, islice
from pathlib import Path
from typing import TextIO, TypeVar

import numpy as np

from imu_recording.recording import BagError, FloatArray
from imu_recording.tables.mapping import ISO_TIME, CsvMapping
from imu_recording.tables.row_range import RowRange
from imu_recording.user_error import did_you_mean

ALL_ROWS = RowRange()
MISSING_TEXTS = frozenset({'', 'nan', 'na', 'n/a', 'null', 'none', '-'})
"""What a cell without a value may hold, in lower case."""
LARGEST_GARBLED_SHARE = 0.01
"""Of more lines that hold what is no number, the mapping or the file is wrong."""
MOST_GARBLED_AT_FIRST = 100
"""Such lines beyond that share after which no more are read."""
DELIMITERS = ',;\t|'
"""Between the cells of a file."""
FIRST_LINES = 50
"""Lines that tell how many cells the rows of a file without a header have."""
Parsed = TypeVar('Parsed')
_INFINITE_TEXTS = frozenset({'inf', '+inf', '-inf', 'infinity', '-infinity'})


def read_table(
    path: Path, mapping: CsvMapping, names: Sequence[str], rows: RowRange = ALL_ROWS
) -> tuple[FloatArray, list[str]]:
    """Return the named columns as (n, len(names)) and notes; raise BagError naming the place.

    Cells without a value are NaN. Lines with another number of cells, and up to one of a hundred
    with what is no number (a serial line garbles some), are left out and counted. Where the
    mapping has the rate of the rows, the first column is their time by count, those left out
    included. Dates become seconds since 1970 (UTC where they name no zone, which is said).
    """
    table, notes = in_its_encoding(path, lambda stream: _parse(stream, path, mapping, names, rows))
    return table, notes


def in_its_encoding(
    path: Path, parse: Callable[[TextIO], tuple[Parsed, list[str]]]
) -> tuple[Parsed, list[str]]:
    """Return what `parse` makes of the file's text and its notes, and how the text was encoded."""
    try:
        with path.open('rb') as stream:
            wide = stream.read(2) in (BOM_UTF16_LE, BOM_UTF16_BE)
        try:
            with path.open(encoding='utf-16' if wide else 'utf-8-sig', newline='') as text:
                parsed, notes = parse(text)
            return parsed, [*notes, 'the file is read as UTF-16'] if wide else notes
        except UnicodeError:
            with path.open(encoding='cp1252', errors='replace', newline='') as text:
                parsed, notes = parse(text)
            return parsed, [*notes, 'the file is not UTF-8: read as Windows-1252 (cp1252)']
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
    header, lines = _headed(_lines(stream, mapping), path, mapping)
    named = names[1:] if mapping.row_rate else names
    places = [_place(name, header, path, mapping) for name in named]
    width = len(header)
    values: list[list[float]] = []
    left_out: list[int] = []
    garbled: list[str] = []
    zoned = mapping.time_unit != ISO_TIME or mapping.zone is not None
    for row, (number, cells) in enumerate(lines):
        if not rows.has_line(number):
            continue
        if len(cells) != width:
            left_out.append(number)
            continue
        counted = [row / mapping.row_rate] if mapping.row_rate else []
        try:
            values.append([*counted, *_row(cells, places, path, number, mapping, named)])
        except BagError as error:
            garbled.append(str(error))
            if len(garbled) > MOST_GARBLED_AT_FIRST + LARGEST_GARBLED_SHARE * len(values):
                break
            continue
        zoned = zoned or _names_zone(cells[places[0][0]])
    notes = [] if zoned else ['the times name no zone: taken as UTC']
    if left_out:
        notes.append(
            f'{len(left_out)} lines do not have {width} cells and are left out '
            f'(first: line {left_out[0]})'
        )
    if len(garbled) > LARGEST_GARBLED_SHARE * len(values):
        raise BagError(garbled[0])
    if garbled:
        first, _, _ = garbled[0].removeprefix(f'{path}, ').partition(';')
        notes.append(f'{len(garbled)} lines are garbled and left out (first: {first})')
    return np.array(values, float).reshape(len(values), len(names)), notes


def _headed(
    lines: Iterator[tuple[int, list[str]]], path: Path, mapping: CsvMapping
) -> tuple[list[str], Iterator[tuple[int, list[str]]]]:
    """Return the names of the columns and the lines below them.

    Without a header they are numbered, as many as most of the first lines have: a log that begins
    in the middle of a line has fewer in its first.
    """
    first = list(islice(lines, 1 if mapping.header else FIRST_LINES))
    if not first:
        raise BagError(f'{path}: the file is empty')
    if mapping.header:
        return [cell.strip() for cell in first[0][1]], lines
    width = Counter(len(cells) for _, cells in first).most_common(1)[0][0]
    cells = first[0][1]
    split = width == 1 and any(sign in cells[0] for sign in DELIMITERS)
    return cells if split else [str(k) for k in range(width)], chain(first, lines)


def _lines(stream: Iterator[str], mapping: CsvMapping) -> Iterator[tuple[int, list[str]]]:
    """Give line number and cells of every line that is neither blank nor a comment."""
    reader = csv.reader(stream, delimiter=mapping.delimiter, skipinitialspace=True)
    for cells in reader:
        text = ''.join(cells).strip()
        if not text or (mapping.comment and text.startswith(mapping.comment)):
            continue
        yield reader.line_num, cells


def _place(name: str, known: list[str], path: Path, mapping: CsvMapping) -> tuple[int, float]:
    """Return the column's index and its sign."""
    for candidate, sign in ((name, 1.0), (name.removeprefix('-').strip(), -1.0)):
        if candidate in known:
            return known.index(candidate), sign
    others = [sign for sign in DELIMITERS if sign != mapping.delimiter]
    split = next((sign for sign in others if len(known) == 1 and sign in known[0]), '')
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
        cell = cells[at]
        value = _date(cell, mapping.zone or UTC) if date else _value(cell, mapping.decimal)
        if value is None:
            raise BagError(
                f'{path}, line {number}, column {name!r}: {cell.strip()!r} is no '
                f'{_expected(cell, mapping, date=date)}'
            )
        values.append(sign * value)
    return values


def _expected(cell: str, mapping: CsvMapping, *, date: bool) -> str:
    """Return what a cell should be, and the setting that may make it so."""
    if date:
        return 'date; write dates as 2024-03-07T12:00:00 (ISO 8601)'
    if mapping.decimal == '.' and _value(cell, ',') is not None:
        return "number; is the decimal sign a comma? (decimal: ',' in the mapping)"
    return 'number; correct it, or leave the cell empty where nothing was measured'


def _value(cell: str, decimal: str) -> float | None:
    text = cell.strip().lower().replace(decimal, '.')
    if text in MISSING_TEXTS:
        return np.nan
    if text in _INFINITE_TEXTS:
        return float(text)
    try:
        return float(text)
    except ValueError:
        return None


def _names_zone(cell: str) -> bool:
    """Tell whether a date says which zone it is of: +01:00 or Z at its end."""
    return bool(re.search(r'(Z|[+-]\d\d:?\d\d)$', cell.strip()))


def _date(cell: str, zone: tzinfo) -> float | None:
    text = cell.strip()
    if text.lower() in MISSING_TEXTS:
        return np.nan
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=zone)).timestamp()
