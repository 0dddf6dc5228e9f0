# SPDX-License-Identifier: Apache-2.0
"""How numbers are shown: the paper's units and no more digits than carry meaning.

>>> shown(0.012345), shown(12.3456), shown(-98765.4), shown(0.0), shown(None)
('0.0123', '12.3', '−98 765', '0', '–')
>>> shown(1.5e-7), with_uncertainty(12.3456, 0.0234)
('1.50e−7', '12.346 ± 0.023')
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from imu_recording.recording import SENSOR_UNITS, FloatArray

from thermal_comp.data.conditions import TABLE_ORDER

SENSORS = TABLE_ORDER
"""Order in which sensors are shown."""


@dataclass(frozen=True)
class DisplayUnit:
    """A unit for people: `value_si * factor` is in `unit`."""

    unit: str
    factor: float

    def of(self, values: FloatArray) -> FloatArray:
        """Return SI values in this unit."""
        converted: FloatArray = values * self.factor
        return converted


DISPLAY_UNITS = {
    'gyroscope': DisplayUnit('°/s', 180.0 / math.pi),
    'accelerometer': DisplayUnit('m/s²', 1.0),
    'magnetometer': DisplayUnit('µT', 1e6),
}
"""Units of Tables III–V."""
SMALL_UNITS = {
    'gyroscope': DisplayUnit('m°/s', 1e3 * 180.0 / math.pi),
    'accelerometer': DisplayUnit('mm/s²', 1e3),
    'magnetometer': DisplayUnit('nT', 1e9),
}
"""Units of what changes per kelvin, volt, second …"""
RELATIVE_UNITS = {'1/K': DisplayUnit('ppm/K', 1e6), 'rad/K': DisplayUnit('µrad/K', 1e6)}
"""Units of scale factors and misalignments over temperature, by those of SI."""
FILTER_LABELS = {'complementary': 'complementary', 'ahrs': 'AHRS'}
"""What a filter is called in text; a filter that is not here goes by its own name."""


def coefficient_unit(sensor: str, unit: str) -> DisplayUnit:
    """Return the unit in which people read a coefficient that has an SI unit.

    >>> coefficient_unit('gyroscope', 'rad/s/K').unit, coefficient_unit('magnetometer', 'T').unit
    ('m°/s/K', 'µT')
    >>> coefficient_unit('accelerometer', '1/K').unit, coefficient_unit('accelerometer', 's').unit
    ('ppm/K', 's')
    """
    own = SENSOR_UNITS[sensor]
    if not unit.startswith(own):
        return RELATIVE_UNITS.get(unit, DisplayUnit(unit, 1.0))
    rest = unit.removeprefix(own)
    table: Mapping[str, DisplayUnit] = SMALL_UNITS if rest else DISPLAY_UNITS
    return DisplayUnit(f'{table[sensor].unit}{rest}', table[sensor].factor)


def shown(value: float | None, digits: int = 3) -> str:
    """Return a number with `digits` significant digits, '–' where there is none."""
    if value is None or not math.isfinite(value):
        return '–'
    if value == 0.0:
        return '0'
    exponent = math.floor(math.log10(abs(float(f'{value:.{digits - 1}e}'))))
    if exponent < -4 or exponent > 6:
        text = f'{value:.{digits - 1}e}'.replace('e-0', 'e-').replace('e+0', 'e')
    else:
        text = f'{value:,.{max(0, digits - 1 - exponent)}f}'.replace(',', ' ')
    return text.replace('-', '−')


def scaled(value: float | None, factor: float) -> float | None:
    """Return a number in another unit, None where there is none."""
    return None if value is None else value * factor


def fixed(value: float | None, decimals: int) -> str:
    """Return a number with so many decimals, '–' where there is none."""
    if value is None or not math.isfinite(value):
        return '–'
    text = f'{value:,.{decimals}f}'.replace(',', ' ')
    if float(text.replace(' ', '')) == 0.0:
        text = text.lstrip('-')
    return text.replace('-', '−')


def with_uncertainty(value: float | None, uncertainty: float | None) -> str:
    """Return 'value ± uncertainty', both to two significant digits of the uncertainty."""
    if value is None or not math.isfinite(value) or not uncertainty:
        return shown(value)
    if not math.isfinite(uncertainty):
        return shown(value)
    rounded = float(f'{uncertainty:.1e}')
    decimals = 1 - math.floor(math.log10(rounded))
    if decimals > 6:
        return _with_power(value, rounded)
    if decimals < 0:
        return f'{fixed(round(value, decimals), 0)} ± {fixed(rounded, 0)}'
    return f'{fixed(value, decimals)} ± {fixed(uncertainty, decimals)}'


def _with_power(value: float, uncertainty: float) -> str:
    """Return both with a common power of ten, as many digits as the uncertainty promises.

    >>> _with_power(0.01112345, 1.7e-6), _with_power(-3.2e-7, 1.5e-9)
    ('(1.11234 ± 0.00017)e−2', '(−3.200 ± 0.015)e−7')
    """
    power = math.floor(math.log10(max(abs(value), uncertainty)))
    scale = 10.0**power
    decimals = max(0, 1 - math.floor(math.log10(uncertainty / scale * (1.0 + 1e-9))))
    pair = f'{fixed(value / scale, decimals)} ± {fixed(uncertainty / scale, decimals)}'
    return f'({pair})e{power}'.replace('e-', 'e−')


def duration(seconds: float) -> str:
    """Return a time span for people.

    >>> duration(42), duration(630), duration(43_200)
    ('42 s', '10.5 min', '12.0 h')
    """
    if seconds < 120:
        return f'{seconds:.0f} s'
    return f'{seconds / 60:.1f} min' if seconds < 7200 else f'{seconds / 3600:.1f} h'
