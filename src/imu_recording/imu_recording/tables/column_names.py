# SPDX-License-Identifier: Apache-2.0
"""How columns of CSV files are called: what they are of, and the units in their names."""

from __future__ import annotations

import re

from imu_recording.tables.mapping import TIME_UNITS, UNIT_SPELLINGS, UNITS

VECTOR_NAMES = {
    'linear_acceleration': r'(lin(ear)?_?)?a(cc(el(eration|erometer)?)?)?',
    'angular_velocity': r'(ang(ular)?_?(vel(ocity)?|rate)|g(yr(o(scope)?)?)?|w|omega)',
    'magnetic_field': r'(m(ag(net(ic(_?field)?|ometer)?)?)?|i|compass)',
}
"""Beginnings of the names of columns, before the axis."""
SCALAR_NAMES = {
    'setpoint': r'(set_?point|target|sp)(_?temp(erature)?)?',
    'chamber_temperature': r'(chamber|oven|ambient|air|outside)(_?t(emp(erature)?)?)?',
    'chamber_temperature_2': r'(chamber|oven|ambient|air|outside)(_?t(emp(erature)?)?)?_?2',
    'device_temperature': r'(((board|case|thermocouple|tc|baro(meter)?|pcb)(_?t(emp(erature)?)?)?)'
    r'|(device_?t(emp(erature)?)?))',
    'temperature': r'((imu|die|d|sensor|chip)_?)?(t|temp(eratur(e)?)?)(_?(die|imu|chip))?',
    'humidity': r'(rh|hum(idity)?|relative_?humidity)',
    'pressure': r'(air_?|baro(meter)?_?)?press(ure)?',
    'heater': r'heat(er|ing)(_?(duty|state|on|power))?',
    'compressor': r'compressor(_?(duty|state|on))?',
    'fan': r'fan(_?(duty|state|on))?',
    'supply_voltage': r'(v|vcc|vdd|supply|voltage)(_?voltage)?',
}
TIME_NAMES = (
    r'((sample|unix|epoch|utc|gps|ros|log|elapsed|system|local)_?)*'
    r'(time(_?stamp)?|stamp|t|date(_?time)?|sec(onds)?|millis|micros|epoch|utc|uptime|elapsed|'
    r'zeit(stempel)?|datum)(_?(s|sec|ms|us|ns))?'
)
NAME_PREFIX = r'(imu\d?|sensor|raw|data)?_?'
NUMBERED_UNITS = {'rad': 'rad/s', 'm_s2': 'm/s²', 'ga': 'gauss'}
"""Units in the names of PX4's topics, whose axes are numbers."""


def spelled_out(name: str) -> str:
    """Return a name whose axis is a number, or whose unit one letter, as others are written.

    >>> spelled_out('gyro_rad[0]'), spelled_out('accelerometer_m_s2[2]'), spelled_out('ax_g')
    ('gyro_x [rad/s]', 'accelerometer_z [m/s²]', 'ax [g]')
    >>> spelled_out('temp_F'), spelled_out('acc_g'), spelled_out('ax [g]')
    ('temp [°F]', 'acc_g', 'ax [g]')
    """
    if numbered := re.fullmatch(r'(\w+)_(rad|m_s2|ga)\[([012])\]', name):
        return f'{numbered[1]}_{"xyz"[int(numbered[3])]} [{NUMBERED_UNITS[numbered[2]]}]'
    if of_axis := re.fullmatch(r'(\w*[xyzXYZ])_([gT])', name):
        return f'{of_axis[1]} [{of_axis[2]}]'
    if of_warmth := re.fullmatch(r'(\w*t(?:emp(?:erature)?)?)_([CFK])', name, re.IGNORECASE):
        unit = of_warmth[2].upper()
        return f'{of_warmth[1]} [{unit if unit == "K" else "°" + unit}]'
    return name


def plain_name(name: str) -> str:
    """Return a name in lower case, without its unit, its parts joined by _.

    >>> [plain_name(n) for n in ('imu.acc.x', 'Gyro X (deg/s)', 'accelX', 'temp_degF')]
    ['imu_acc_x', 'gyro_x', 'accel_x', 'temp']
    """
    bare = re.sub(r'[\[(].*?[\])]', '', name).strip()
    first, _, last = bare.rpartition('_')
    bare = first if first and len(last) > 1 and _known_unit(last) else bare
    bare = re.sub(r'(?<=[a-z])(?=[A-Z])', '_', bare)
    parts = [part for part in re.split(r'[^0-9a-zA-Z]+', bare.lower()) if part]
    if len(parts) > 1 and len(parts[-1]) > 1 and _known_unit(parts[-1]):
        parts.pop()
    return '_'.join(parts)


def unit_in_name(name: str) -> str:
    """Return what stands in brackets, or after the last _, '' where that is no unit.

    >>> [unit_in_name(n) for n in ('ax [g]', 'gyro_x_dps', 'temp', 'acc_g')]
    ['g', 'dps', '', '']
    """
    bracket = re.search(r'[\[(](.*?)[\])]', name)
    if bracket:
        unit = bracket[1].strip()
        return unit if unit and _known_unit(unit) else ''
    unit = name.rpartition('_')[2] if '_' in name else ''
    return unit if len(unit) > 1 and _known_unit(unit) else ''


def _known_unit(word: str) -> bool:
    listed = {unit.lower() for known in UNITS.values() for unit in known}
    return word.lower() in {*listed, *UNIT_SPELLINGS, *TIME_UNITS}
