# SPDX-License-Identifier: Apache-2.0
"""A mapping for a CSV file from its header and the range of its numbers, and what is unsure."""

from __future__ import annotations

import csv
import io
import itertools
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from imu_recording.plausibility import rate_at_rest
from imu_recording.recording import STANDARD_GRAVITY, BagError, FloatArray, ImuRecording
from imu_recording.tables.column_names import (
    NAME_PREFIX,
    SCALAR_NAMES,
    TIME_NAMES,
    VECTOR_NAMES,
    plain_name,
    spelled_out,
    unit_in_name,
)
from imu_recording.tables.csv_import import LATEST_STAMP_NS, fields_of
from imu_recording.tables.csv_table import DELIMITERS, in_its_encoding
from imu_recording.tables.mapping import (
    TIME_UNITS,
    UNIT_SPELLINGS,
    UNITS,
    CsvMapping,
    mapping_from,
)

MOST_READ_LINES = 5000
"""Number of lines that are read."""
COMMENT_SIGNS = '#%'
"""First characters of lines above a header."""
DECIMAL_COMMA = re.compile(r'[-+]?\d+,\d+')
LARGEST_SHARES = {'1': 1.0, '%': np.inf}
LARGEST_VALUES = {
    'humidity': LARGEST_SHARES,
    'heater': LARGEST_SHARES,
    'compressor': LARGEST_SHARES,
    'fan': LARGEST_SHARES,
    'supply_voltage': {'V': 100.0, 'mV': np.inf},
    'pressure': {'bar': 2.0, 'kPa': 200.0, 'hPa': 2000.0, 'Pa': np.inf},
}
"""Units of a channel that states none, in this order: each up to this greatest value."""
NORMS_IN_UNITS = {
    'linear_acceleration': {'m/s²': STANDARD_GRAVITY, 'g': 1.0, 'mg': 1000.0},
    'magnetic_field': {'T': 5e-5, 'µT': 50.0, 'gauss': 0.5, 'mG': 500.0, 'nT': 5e4},
}
"""Norm that gravity and Earth's field have in each unit."""
COUNTS_PER_G = (2048, 4096, 8192, 16384)
LARGEST_K_PER_S = 0.5
"""Fastest mean change of a temperature over a file that is plausible."""
LARGEST_STEPS_BACK_SHARE = 0.01
"""Largest share of a clock's steps that go back."""
WARMEST_C = 60.0
"""Temperature above which the user is asked: most boards are this warm in °F only."""
ASSUMED_RATE_UNIT = 'angular_velocity: no unit in the header, taken as rad/s'
DATES_S = (1e9, 4e9)
"""Unix times from 2001 to 2096 [s]."""
USUAL_PERIOD_S = 0.02
"""Usual sample period: among possible units of time the one that comes nearest is taken."""


@dataclass
class Guess:
    """A mapping as its file would hold it, and what the user has to check."""

    mapping: dict[str, Any]
    unsure: list[str] = field(default_factory=list)


def guess_mapping(path: Path, *, beside: bool = False) -> Guess:
    """Return the mapping a CSV file probably needs.

    `beside` that of a board it may be the log of a chamber. Raises BagError where there is no
    header, no time, or neither a vector of a sensor nor, beside another, any channel in it.
    """
    delimiter, decimal, header, table, comment = _table(path)
    spelled = {name: spelled_out(name) for name in header}
    names = {name: plain_name(written) for name, written in spelled.items()}
    units = {name: unit_in_name(written) for name, written in spelled.items()}
    columns: dict[str, Any] = {}
    unsure: list[str] = []
    values = dict(zip(header, table.T, strict=True))
    for field_name, pattern in VECTOR_NAMES.items():
        found = _vector(names, pattern) or _vector_of_unit(field_name, names, units)
        if found:
            with_unit = _vector_unit(
                field_name, [values[n] for n in found], units[found[0]], unsure
            )
            columns[field_name] = {'columns': found, **with_unit}
    if not beside:
        _refuse_without_vector(path, header, columns)
    taken = {name for entry in columns.values() for name in entry['columns']}
    clock = _time_column(path, names, values)
    taken.add(clock)
    for field_name, pattern in SCALAR_NAMES.items():
        free = (
            n for n in header if n not in taken and re.fullmatch(NAME_PREFIX + pattern, names[n])
        )
        name = next(free, None)
        if name is not None:
            taken.add(name)
            with_unit = _scalar_unit(field_name, name, values[name], units[name], unsure)
            columns[field_name] = {'column': name, **with_unit}
    if beside:
        _of_the_chamber(path, header, columns, unsure)
    elif 'temperature' not in columns:
        unsure.append('no column looks like the temperature of the die')
    warm = columns.get('temperature', columns.get('chamber_temperature'))
    temperature = values[warm['column']] if warm else None
    unit = _time_unit(clock, values[clock], units[clock], temperature, unsure)
    time = {'column': clock, 'unit': unit}
    device = {} if beside else {'device': path.stem}
    mapping: dict[str, Any] = {'schema': 1, **device, 'time': time, 'columns': columns}
    mapping |= {'delimiter': delimiter} if delimiter != ',' else {}
    mapping |= {'decimal': decimal} if decimal != '.' else {}
    mapping |= {'comment': comment} if comment else {}
    _check_rates(mapping, values, unsure)
    left = [name for name in header if name not in taken]
    if left:
        unsure.append(f'not used: {", ".join(left)}')
    return Guess(mapping, unsure)


def _refuse_without_vector(path: Path, header: Sequence[str], columns: Mapping[str, Any]) -> None:
    if not columns:
        raise BagError(
            f'{path}: no columns such as ax, ay, az or gyro_x, gyro_y, gyro_z in its header '
            f'({", ".join(header)}); write a mapping (--mapping)'
        )


def _of_the_chamber(
    path: Path, header: Sequence[str], columns: dict[str, Any], unsure: list[str]
) -> None:
    """Take what is just a temperature for that of the air, in the log of a chamber."""
    if not columns:
        raise BagError(
            f'{path}: no column looks like a channel of a chamber ({", ".join(header)}); write a '
            'mapping (--mapping)'
        )
    if VECTOR_NAMES.keys() & columns.keys() or 'temperature' not in columns:
        return
    name = columns['temperature']['column']
    if 'chamber_temperature' not in columns:
        columns['chamber_temperature'] = columns.pop('temperature')
        unsure.append(f'chamber_temperature: {name} is taken for the air, not for a die')


def _time_column(path: Path, names: Mapping[str, str], values: Mapping[str, FloatArray]) -> str:
    """Return the column that is called like a time and hardly ever goes back."""
    for name, plain in names.items():
        known = values[name][np.isfinite(values[name])]
        back = np.count_nonzero(np.diff(known) < 0.0)
        if re.fullmatch(
            NAME_PREFIX + TIME_NAMES, plain
        ) and back <= LARGEST_STEPS_BACK_SHARE * len(known):
            return name
    raise BagError(
        f'{path}: no column looks like the time; write a mapping (--mapping), of a file without '
        'times with the rate of its rows (time: {rate: 100})'
    )


def _beginning(stream: TextIO) -> tuple[tuple[str, list[list[str]]], list[str]]:
    """Return delimiter and cells of the first lines that are not blank; no notes."""
    text = ''.join(itertools.islice(stream, MOST_READ_LINES))
    filled = (line for line in text.splitlines() if line.strip())
    first = next((line for line in filled if line[0] not in COMMENT_SIGNS), '')
    delimiter = max(DELIMITERS, key=first.count)
    lines = csv.reader(io.StringIO(text, newline=''), delimiter=delimiter, skipinitialspace=True)
    return (delimiter, [row for row in lines if any(row)]), []


def _table(path: Path) -> tuple[str, str, list[str], FloatArray, str]:
    """Return delimiter, decimal sign, header, (n, columns) of the first lines, comment sign."""
    (delimiter, rows), _ = in_its_encoding(path, _beginning)
    comment = rows[0][0][:1] if rows and rows[0][0][:1] in tuple(COMMENT_SIGNS) else ''
    rows = [row for row in rows if not (comment and row[0].startswith(comment))]
    if not rows:
        raise BagError(f'{path}: the file is empty')
    header = [cell.strip() for cell in rows[0]]
    if not ''.join(header).isprintable():
        raise BagError(f'{path}: is no text; give a CSV file or a whole PX4 or ArduPilot log')
    if len(header) < 2 or all(np.isfinite(_number(cell)) for cell in header):
        raise BagError(
            f'{path}: its first line is no header; write a mapping (--mapping) with '
            'header: false and columns numbered from 0'
        )
    if len(set(header)) < len(header):
        raise BagError(f'{path}: two columns have the same name; write a mapping (--mapping)')
    widths = Counter(len(row) for row in rows[1:])
    rows = [row for row in rows[1:] if len(row) == len(header)]
    commas = sum(bool(DECIMAL_COMMA.fullmatch(cell.strip())) for row in rows for cell in row)
    points = sum('.' in cell for row in rows for cell in row)
    decimal = ',' if commas > points else '.'
    numbers = [[_number(cell.replace(decimal, '.')) for cell in row] for row in rows]
    if not numbers:
        raise BagError(
            f'{path}: no line has as many cells as its header, {len(header)}'
            f'{_other_width(widths, len(header), delimiter)}'
        )
    return delimiter, decimal, header, np.array(numbers), comment


def _other_width(widths: Counter[int], columns: int, delimiter: str) -> str:
    """Return how many cells most lines have instead, and what that looks like."""
    if not widths:
        return '; no line follows it'
    cells = widths.most_common(1)[0][0]
    doubled = delimiter == ',' and columns < cells <= 2 * columns
    commas = ': decimal commas? Export it with decimal points, or another delimiter'
    return f'; most have {cells}{commas if doubled else ""}'


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan


def _vector(names: Mapping[str, str], pattern: str) -> list[str]:
    """Return the three columns whose names differ in the axis alone; [] where there are none."""
    found: dict[str, str] = {}
    for name, plain in names.items():
        match = re.fullmatch(rf'{NAME_PREFIX}{pattern}_?(?P<axis>[xyz])', plain)
        if match:
            found.setdefault(match['axis'], name)
    return [found[axis] for axis in 'xyz'] if len(found) == 3 else []


def _vector_of_unit(
    field_name: str, names: Mapping[str, str], units: Mapping[str, str]
) -> list[str]:
    """Return three columns x, y, z of a sensor's unit, in whatever language they are named."""
    own = {name: plain for name, plain in names.items() if _is_of(field_name, units[name])}
    return _vector(own, r'[a-z0-9_]*?')


def _vector_unit(
    name: str, columns: Sequence[FloatArray], stated_unit: str, unsure: list[str]
) -> dict[str, Any]:
    if stated_unit and _is_of(name, stated_unit):
        return {'unit': stated_unit}
    values = np.stack(columns, axis=1)
    known = values[np.isfinite(values).all(axis=1)]
    if not len(known):
        unsure.append(f'{name}: no cell of {len(values)} lines is a number')
        return {'unit': next(iter(UNITS[name]))}
    with np.errstate(over='ignore'):
        norm = float(np.median(np.linalg.norm(known, axis=1)))
    counts = bool(np.all(known % 1.0 == 0.0))
    if name == 'angular_velocity':
        if counts:
            unsure.append(f'{name}: whole numbers, taken as counts of 1/131 °/s (±250 °/s)')
            return {'scale': '1/131', 'unit': '°/s'}
        unsure.append(ASSUMED_RATE_UNIT)
        if 0.85 < norm / STANDARD_GRAVITY < 1.15:
            unsure.append(f'{name}: its norm, {norm:.4g}, is gravity: are they the accelerometer?')
        return {'unit': 'rad/s'}
    if counts and name == 'linear_acceleration':
        nearest = min(COUNTS_PER_G, key=lambda c: abs(np.log(max(norm, 1e-9) / c)))
        if 0.7 < norm / nearest < 1.4:
            unsure.append(f'{name}: whole numbers, taken as counts of 1/{nearest} g')
            return {'scale': f'1/{nearest}', 'unit': 'g'}
    unit, size = min(
        NORMS_IN_UNITS[name].items(), key=lambda u: abs(np.log(max(norm, 1e-12) / u[1]))
    )
    if not 0.4 < norm / size < 2.5 or counts:
        unsure.append(f'{name}: its norm, {norm:.4g}, is that of no unit: scale and unit?')
    return {'unit': unit}


def _scalar_unit(
    name: str, column: str, values: FloatArray, stated_unit: str, unsure: list[str]
) -> dict[str, Any]:
    if stated_unit and _is_of(name, stated_unit):
        return {'unit': stated_unit}
    known = values[np.isfinite(values)]
    middle = float(np.median(known)) if len(known) else np.nan
    if name in LARGEST_VALUES:
        greatest = float(known.max()) if len(known) else np.nan
        return {'unit': next(u for u, most in LARGEST_VALUES[name].items() if not greatest > most)}
    if WARMEST_C < middle < 130.0:
        unsure.append(f'{name}: {column} is about {middle:.3g}, taken as °C: or is it °F?')
    if -60.0 < middle < 130.0:
        return {'unit': '°C'}
    if 200.0 < middle < 400.0:
        return {'unit': 'K'}
    unsure.append(f'{name}: {column} is about {middle:.4g}, no temperature: scale and offset?')
    return {'unit': '°C'}


def _is_of(name: str, unit: str) -> bool:
    """Tell whether a unit is one of a field's: mg is no mG where it is written so."""
    written = {field_name for field_name, known in UNITS.items() if unit in known}
    if written:
        return name in written
    return UNIT_SPELLINGS.get(unit.lower(), unit).lower() in {
        known.lower() for known in UNITS[name]
    }


def _check_rates(
    mapping: dict[str, Any], values: Mapping[str, FloatArray], unsure: list[str]
) -> None:
    """Take rates without a unit for °/s where a device at rest would be too loud in rad/s."""
    if ASSUMED_RATE_UNIT not in unsure or 'linear_acceleration' not in mapping['columns']:
        return
    checked = mapping_from(mapping)
    table = np.column_stack([values[name] for name in _names(checked)])
    with np.errstate(over='ignore'):
        time: FloatArray = table[:, 0] * TIME_UNITS.get(checked.time_unit, np.nan)
    if not (np.abs(time) < LATEST_STAMP_NS).all() or not (np.diff(time) > 0.0).all():
        time = np.arange(len(table), dtype=np.float64) * (USUAL_PERIOD_S * 1e9)
    fields = fields_of(checked, table)
    nothing = np.full((len(table), 3), np.nan)
    recording = ImuRecording(
        stamp=time.astype(np.int64),
        angular_velocity=fields['angular_velocity'],
        linear_acceleration=fields['linear_acceleration'],
        magnetic_field=fields.get('magnetic_field', nothing),
        temperature=nothing[:, 0],
    )
    if why := rate_at_rest(recording):
        mapping['columns']['angular_velocity']['unit'] = '°/s'
        unsure[unsure.index(ASSUMED_RATE_UNIT)] = (
            f'angular_velocity: taken as °/s; in rad/s: {why}'
        )


def _names(mapping: CsvMapping) -> list[str]:
    return [mapping.time_column, *(column.column for column in mapping.columns)]


def _time_unit(
    name: str,
    values: FloatArray,
    stated_unit: str,
    temperature: FloatArray | None,
    unsure: list[str],
) -> str:
    """Return the unit in which period and change of temperature are those of a recording."""
    if stated_unit in TIME_UNITS:
        return stated_unit
    known = values[np.isfinite(values)]
    if len(known) < 2:
        return 'iso8601'
    step = float(np.median(np.abs(np.diff(known))))
    possible = [u for u in _possible_units(known, step, temperature) if step > 0.0]
    if not possible:
        unsure.append(f'time: steps of {name} are {step:.4g}: unit?')
        return 's'
    dated = [u for u in possible if DATES_S[0] < known[0] * TIME_UNITS[u] * 1e-9 < DATES_S[1]]
    if len(dated) == 1:
        return dated[0]
    periods = {unit: step * TIME_UNITS[unit] * 1e-9 for unit in possible}
    unit = min(periods, key=lambda u: abs(np.log(periods[u] / USUAL_PERIOD_S)))
    if len(possible) > 1:
        unsure.append(f'time: {name} in {unit} makes a period of {periods[unit]:.3g} s')
    return unit


def _possible_units(
    time: FloatArray, step: float, temperature: FloatArray | None
) -> Iterator[str]:
    span = 0.0
    if (
        temperature is not None
        and np.isfinite(temperature).any()
        and np.nanmax(np.abs(temperature)) < 400.0
    ):
        known = temperature[np.isfinite(temperature)]
        n = max(1, len(known) // 20)
        span = abs(float(np.median(known[-n:]) - np.median(known[:n])))
    for unit in ('s', 'ms', 'us', 'ns'):
        seconds = TIME_UNITS[unit] * 1e-9
        length = float(time.max() - time.min()) * seconds
        if 1e-4 <= step * seconds <= 60.0 and span <= LARGEST_K_PER_S * length:
            yield unit
