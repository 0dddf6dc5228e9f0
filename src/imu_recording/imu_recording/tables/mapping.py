# SPDX-License-Identifier: Apache-2.0
"""The mapping of a CSV file's columns to the fields of a recording, a small YAML file.

    schema: 1
    device: freeimu
    up_axis: +z                      # optional; otherwise inferred from gravity
    time: {column: Time, unit: ms}   # s, ms, us, ns, min, h or iso8601
    columns:
      linear_acceleration: {columns: [Ax, Ay, -Az], scale: 1/16384, unit: g}
      temperature: {column: dTemp, scale: 1/340, offset: 36.53, unit: °C}

The log of a chamber beside that of a board has a mapping of its own, without vectors. The
relation of clocks is given with the time: `zone: +01:00` for dates that name none, `offset:
1712.5` (seconds that are added), `start: 2024-03-07T12:00:00+01:00` (when a clock that counts was
zero). Of a file without times, `time: {rate: 100}` says how many rows a second has.

A value is (cell × scale + offset) in the unit given; a minus before a name turns the axis around.
`scale` and `offset` are numbers or fractions, for a vector also one per axis. Columns are named by
the header, or numbered from 0 with `header: false`. Further keys: `frame_id`, `run`, `profile`,
`delimiter` (default ','), `comment`, `decimal` (default '.').
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from pathlib import Path
from typing import Any

import yaml

from imu_recording.logging_contract import MEASURED_FIELDS
from imu_recording.recording import STANDARD_GRAVITY, UP_AXES, RecordingError
from imu_recording.user_error import did_you_mean, fault_in_yaml

_RATE_UNITS = {
    'rad/s': 1.0,
    'mrad/s': 1e-3,
    'deg/s': math.pi / 180,
    '°/s': math.pi / 180,
    'mdeg/s': math.pi / 180e3,
    'deg/h': math.pi / 180 / 3600,
}
_FORCE_UNITS = {
    'm/s²': 1.0,
    'm/s^2': 1.0,
    'm/s2': 1.0,
    'g': STANDARD_GRAVITY,
    'mg': 1e-3 * STANDARD_GRAVITY,
}
_FIELD_UNITS = {
    'T': 1.0,
    'mT': 1e-3,
    'µT': 1e-6,
    'uT': 1e-6,
    'nT': 1e-9,
    'G': 1e-4,
    'gauss': 1e-4,
    'mG': 1e-7,
}
_SHARE_UNITS = {'1': 1.0, '%': 0.01}
_PRESSURE_UNITS = {'Pa': 1.0, 'hPa': 100.0, 'mbar': 100.0, 'kPa': 1e3, 'bar': 1e5}
_VARIANCE_UNITS = {
    '(m/s²)²': 1.0,
    'm²/s⁴': 1.0,
    'm^2/s^4': 1.0,
    'g²': STANDARD_GRAVITY**2,
    'g^2': STANDARD_GRAVITY**2,
}
_CELSIUS_UNITS = {'°C': (1.0, 0.0), 'C': (1.0, 0.0), 'K': (1.0, -273.15)}
_FAHRENHEIT_UNITS = dict.fromkeys(('°F', 'F'), (5 / 9, -32 * 5 / 9))
_TEMPERATURE_UNITS = _CELSIUS_UNITS | _FAHRENHEIT_UNITS

UNIT_SPELLINGS = {
    'dps': '°/s',
    'deg/sec': '°/s',
    'degrees/s': '°/s',
    'mdps': 'mdeg/s',
    'dph': 'deg/h',
    'rad/sec': 'rad/s',
    'rps': 'rad/s',
    'm/s/s': 'm/s²',
    'mps2': 'm/s²',
    'milli-g': 'mg',
    'mgauss': 'mG',
    'milligauss': 'mG',
    'microtesla': 'µT',
    'μt': 'µT',
    'tesla': 'T',
    'degc': '°C',
    'deg c': '°C',
    'celsius': '°C',
    'degf': '°F',
    'deg f': '°F',
    'fahrenheit': '°F',
    'kelvin': 'K',
    'volt': 'V',
    'volts': 'V',
    'percent': '%',
    'pascal': 'Pa',
    'millibar': 'mbar',
}
"""Other spellings of units, in lower case."""

TIME_UNITS = {'s': 1e9, 'ms': 1e6, 'µs': 1e3, 'us': 1e3, 'ns': 1.0, 'min': 60e9, 'h': 3600e9}
"""Nanoseconds per unit of a time column."""
ISO_TIME = 'iso8601'
"""Unit of a time column that holds dates such as 2014-01-02T12:00:00.5."""

UNITS: dict[str, dict[str, tuple[float, float]]] = {
    'angular_velocity': {unit: (factor, 0.0) for unit, factor in _RATE_UNITS.items()},
    'linear_acceleration': {unit: (factor, 0.0) for unit, factor in _FORCE_UNITS.items()},
    'magnetic_field': {unit: (factor, 0.0) for unit, factor in _FIELD_UNITS.items()},
    'temperature': _TEMPERATURE_UNITS,
    'chamber_temperature': _TEMPERATURE_UNITS,
    'chamber_temperature_2': _TEMPERATURE_UNITS,
    'device_temperature': _TEMPERATURE_UNITS,
    'setpoint': _TEMPERATURE_UNITS,
    'humidity': {unit: (factor, 0.0) for unit, factor in _SHARE_UNITS.items()},
    'pressure': {unit: (factor, 0.0) for unit, factor in _PRESSURE_UNITS.items()},
    'heater': {unit: (factor, 0.0) for unit, factor in _SHARE_UNITS.items()},
    'compressor': {unit: (factor, 0.0) for unit, factor in _SHARE_UNITS.items()},
    'fan': {unit: (factor, 0.0) for unit, factor in _SHARE_UNITS.items()},
    'supply_voltage': {'V': (1.0, 0.0), 'mV': (1e-3, 0.0)},
    'vibration': {unit: (factor, 0.0) for unit, factor in _VARIANCE_UNITS.items()},
}
"""By field of ImuRecording and unit: (factor, offset) to that field's unit."""

UNIT_OF_FIELD = {
    field: 'share' if '1' in known else next(iter(known)) for field, known in UNITS.items()
}
"""Unit of each field of a recording: what all others are converted to."""

VECTOR_FIELDS = (*MEASURED_FIELDS, 'vibration')
"""Fields that take three columns."""


SCHEMA_VERSION = 1
TEXT_KEYS = ('device', 'run', 'profile', 'frame_id', 'up_axis')


class MappingError(RecordingError):
    """A column mapping that cannot be used; the message names the file and the key."""


@dataclass(frozen=True)
class CsvColumn:
    """One column and how its cells become numbers of one component of a field."""

    field: str
    axis: int
    column: str
    factor: float
    offset: float


@dataclass(frozen=True)
class CsvMapping:
    """A checked mapping."""

    columns: tuple[CsvColumn, ...]
    time_column: str
    """'': the file has no times, its rows are counted."""
    time_unit: str
    row_rate: float = 0.0
    """Rows a second of a file without times [1/s]."""
    time_offset: float = 0.0
    """Added to the times of the file [s]."""
    zone: tzinfo | None = None
    """Of dates that name none; None: UTC is assumed."""
    device: str = ''
    run: str = ''
    profile: str = ''
    frame_id: str = 'imu_link'
    up_axis: str = ''
    delimiter: str = ','
    comment: str = ''
    decimal: str = '.'
    header: bool = True

    @property
    def clock(self) -> str:
        """Where the times come from, as a message calls it."""
        return 'time: rate' if self.row_rate else f'column {self.time_column!r}'


def load_mapping(path: str | Path, *, beside: bool = False) -> CsvMapping:
    """Read a mapping file; raise MappingError naming the file and what is wrong."""
    contents = mappings_in(path)
    if len(contents) != 1:
        raise MappingError(f'{path}: {len(contents)} mappings in it, expected one')
    return mapping_from(contents[0], str(path), beside=beside)


def mappings_in(path: str | Path) -> list[Any]:
    """Return what a mapping file holds: one mapping, or several with --- between them."""
    path = Path(path)
    try:
        contents = list(yaml.safe_load_all(path.read_text(encoding='utf-8')))
    except OSError as error:
        raise MappingError(f'{path}: cannot be read ({error.strerror})') from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise MappingError(f'{path}: not a YAML file: {fault_in_yaml(error)}') from None
    return contents or [None]


def mapping_from(content: Any, name: str = 'mapping', *, beside: bool = False) -> CsvMapping:
    """Check the content of a mapping; `beside` others, it needs no vector of a sensor."""
    if not isinstance(content, Mapping):
        raise MappingError(f'{name}: expected keys schema, time, columns')
    known = {'schema', 'time', 'columns', 'delimiter', 'comment', 'decimal', 'header', *TEXT_KEYS}
    _refuse_unknown(content, known, name)
    if content.get('schema') != SCHEMA_VERSION:
        raise MappingError(
            f'{name}: schema is {content.get("schema")!r}, expected {SCHEMA_VERSION}'
        )
    texts: dict[str, Any] = {
        key: str(content[key]) for key in TEXT_KEYS if content.get(key) is not None
    }
    if texts.get('up_axis', '+z') not in UP_AXES:
        raise MappingError(
            f'{name}: up_axis is {texts["up_axis"]!r}, expected one of {", ".join(UP_AXES)}'
        )
    for key in ('delimiter', 'comment', 'decimal'):
        value = content.get(key)
        if value is None:
            continue
        if not isinstance(value, str) or (key != 'comment' and len(value) != 1):
            raise MappingError(f'{name}: {key} is {value!r}, expected a single character')
        texts[key] = value
    return CsvMapping(
        columns=_columns(content.get('columns'), name, beside=beside),
        **_time(content.get('time'), name),
        header=content.get('header', True) is not False,
        **texts,
    )


def _time(entry: Any, name: str) -> dict[str, Any]:
    """Return the fields of a mapping that are about the time."""
    if not isinstance(entry, Mapping) or not {'column', 'rate'} & set(entry):
        raise MappingError(
            f'{name}: time: expected a column and its unit, or of a file without times '
            'the rate of its rows (time: {rate: 100})'
        )
    if 'rate' in entry:
        return _counted(entry, name)
    _refuse_unknown(entry, {'column', 'unit', 'offset', 'zone', 'start'}, f'{name}: time')
    unit = str(entry.get('unit', 's'))
    if unit not in (*TIME_UNITS, ISO_TIME):
        known = ', '.join((*TIME_UNITS, ISO_TIME))
        raise MappingError(f'{name}: time: unit is {unit!r}, expected one of {known}')
    if 'zone' in entry and unit != ISO_TIME:
        raise MappingError(f'{name}: time: zone is of dates (unit: {ISO_TIME}), not of {unit!r}')
    if 'start' in entry and unit == ISO_TIME:
        raise MappingError(f'{name}: time: start is of a clock that counts, not of dates')
    return {
        'time_column': str(entry['column']),
        'time_unit': unit,
        'time_offset': _time_offset(entry, name),
        'zone': _zone(entry['zone'], name) if 'zone' in entry else None,
    }


def _counted(entry: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the fields of a mapping about the time where rows are counted."""
    _refuse_unknown(entry, {'rate', 'offset', 'start'}, f'{name}: time')
    rate = _number(entry['rate'], f'{name}: time: rate')
    if rate <= 0.0:
        raise MappingError(f'{name}: time: rate is {rate:g}, expected rows a second above 0')
    return {
        'time_column': '',
        'time_unit': 's',
        'row_rate': rate,
        'time_offset': _time_offset(entry, name),
    }


def _time_offset(entry: Mapping[str, Any], name: str) -> float:
    """Return what is added to the times of a file [s]."""
    offset = _number(entry.get('offset', 0), f'{name}: time: offset')
    return offset + (_start(entry['start'], name) if 'start' in entry else 0.0)


def _start(date: Any, name: str) -> float:
    """Return the seconds from 1970 to a date; YAML makes a datetime of most."""
    try:
        moment = date if isinstance(date, datetime) else datetime.fromisoformat(str(date))
    except ValueError:
        raise MappingError(
            f'{name}: time: start is {date!r}, expected a date such as 2024-03-07T12:00:00+01:00'
        ) from None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _zone(zone: Any, name: str) -> tzinfo:
    """Return a zone such as +01:00, UTC or Z; YAML makes minutes of +10:00."""
    text = str(zone).strip()
    if text.upper() in ('UTC', 'Z'):
        return UTC
    match = re.fullmatch(r'([+-])(\d\d?):?(\d\d)', text)
    minutes = zone if isinstance(zone, int) and not isinstance(zone, bool) else None
    if match and minutes is None:
        minutes = int(f'{match[1]}1') * (60 * int(match[2]) + int(match[3]))
    if minutes is None or abs(minutes) > 14 * 60:
        raise MappingError(f'{name}: time: zone is {zone!r}, expected +01:00 or UTC')
    return timezone(timedelta(minutes=minutes))


def _columns(fields: Any, name: str, *, beside: bool) -> tuple[CsvColumn, ...]:
    if not isinstance(fields, Mapping) or not fields:
        raise MappingError(f'{name}: columns: expected at least one of {", ".join(UNITS)}')
    _refuse_unknown(fields, set(UNITS), f'{name}: columns')
    if not beside and not set(fields) & set(MEASURED_FIELDS):
        sensors = ', '.join(MEASURED_FIELDS)
        raise MappingError(f'{name}: columns: expected at least one of {sensors}')
    columns: list[CsvColumn] = []
    for field, entry in fields.items():
        columns += _field(field, entry, f'{name}: columns: {field}')
    return tuple(columns)


def _field(field: str, entry: Any, place: str) -> list[CsvColumn]:
    key = 'columns' if field in VECTOR_FIELDS else 'column'
    if not isinstance(entry, Mapping) or key not in entry:
        raise MappingError(f'{place}: expected the key {key}')
    _refuse_unknown(entry, {key, 'scale', 'offset', 'unit'}, place)
    count = 3 if field in VECTOR_FIELDS else 1
    names = entry[key] if field in VECTOR_FIELDS else [entry[key]]
    if not isinstance(names, list) or len(names) != count:
        raise MappingError(f'{place}: {key} is {entry[key]!r}, expected {count} columns')
    unit = _unit(entry.get('unit'), UNITS[field], place)
    factor, shift = UNITS[field][unit]
    scales = _numbers(entry.get('scale', 1), count, f'{place}: scale')
    offsets = _numbers(entry.get('offset', 0), count, f'{place}: offset')
    return [
        CsvColumn(
            field=field,
            axis=axis,
            column=str(column),
            factor=scale * factor,
            offset=offset * factor + shift,
        )
        for axis, (column, scale, offset) in enumerate(zip(names, scales, offsets, strict=True))
    ]


def _unit(given: Any, known: Mapping[str, tuple[float, float]], place: str) -> str:
    """Return the unit's name in the table of its field; other usual spellings are accepted."""
    if given is None:
        return next(iter(known))
    name = str(given).strip()
    alike = [unit for unit in known if unit.lower() == name.lower()]
    candidates = [name, UNIT_SPELLINGS.get(name.lower(), ''), *(alike if len(alike) == 1 else [])]
    for candidate in candidates:
        if candidate in known:
            return candidate
    raise MappingError(
        f'{place}: unit is {name!r}{did_you_mean(name, known)}, expected one of {", ".join(known)}'
    )


def _numbers(given: Any, count: int, place: str) -> list[float]:
    values = given if isinstance(given, list) else [given] * count
    if len(values) != count:
        raise MappingError(f'{place} has {len(values)} numbers, expected {count}')
    return [_number(value, place) for value in values]


def _number(given: Any, place: str) -> float:
    """Return a number or a fraction such as 1/16384."""
    try:
        above, _, below = str(given).partition('/')
        value = float(above) / float(below or 1)
    except (ValueError, ZeroDivisionError):
        value = math.nan
    if isinstance(given, bool) or not math.isfinite(value):
        raise MappingError(f'{place} is {given!r}, expected a number or a fraction')
    return value


def _refuse_unknown(entry: Mapping[Any, Any], known: set[str], place: str) -> None:
    unknown = sorted(str(key) for key in set(entry) - known)
    if unknown:
        raise MappingError(
            f'{place}: unknown key {unknown[0]!r}{did_you_mean(unknown[0], known)}; '
            f'known: {", ".join(sorted(known))}'
        )
