# SPDX-License-Identifier: Apache-2.0
"""Limits of the coefficients of a device, and whether a value with its uncertainty keeps them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from imu_recording.recording import SENSOR_UNITS, STANDARD_GRAVITY
from imu_recording.user_error import UserError

from imu_workbench.report.checked_yaml import read_checked

RAD_PER_DEG = math.pi / 180.0
SI_FACTORS: Mapping[str, Mapping[str, float]] = {
    'accelerometer': {
        'm/s²': 1.0, 'm/s^2': 1.0, 'mm/s²': 1e-3, 'g': STANDARD_GRAVITY,
        'mg': 1e-3 * STANDARD_GRAVITY, 'µg': 1e-6 * STANDARD_GRAVITY,
    },
    'gyroscope': {
        'rad/s': 1.0, '°/s': RAD_PER_DEG, 'deg/s': RAD_PER_DEG, 'dps': RAD_PER_DEG,
        'm°/s': 1e-3 * RAD_PER_DEG, 'mdps': 1e-3 * RAD_PER_DEG,
        '°/h': RAD_PER_DEG / 3600.0, 'deg/h': RAD_PER_DEG / 3600.0,
    },
    'magnetometer': {'T': 1.0, 'µT': 1e-6, 'uT': 1e-6, 'nT': 1e-9, 'G': 1e-4, 'mG': 1e-7},
}  # fmt: skip
"""Units a limit may have, in the sensor's SI unit."""
UNIT_SUFFIXES = {'bias': '', 'slope': '/K'}
"""Suffix of the sensor's unit for a coefficient; an effect has units of its own."""
Rule = Literal['guarded', 'simple']
Decision = Literal['pass', 'fail', 'undecided']


@dataclass(frozen=True)
class CoefficientLimit:
    """Lower and upper limit of one coefficient on every axis, in SI units; ±∞ where not given."""

    lower: float
    upper: float
    unit: str
    """SI unit of the limits, that of the coefficient: `m/s²`, `rad/s/K` …"""

    def decide(self, value: float, width: float, rule: Rule) -> Decision:
        """Return whether a value [SI] keeps the limits with a guard band of a width [SI].

        `guarded`: pass only inside by the width, fail only outside by it, else undecided
        (ILAC-G8:09/2019). `simple`: the value alone decides.

        >>> limit = CoefficientLimit(-1.0, 1.0, 'm/s²')
        >>> [limit.decide(value, 0.2, 'guarded') for value in (0.7, 0.9, 1.3)]
        ['pass', 'undecided', 'fail']
        >>> limit.decide(0.9, 0.2, 'simple')
        'pass'
        """
        if not math.isfinite(value) or (rule == 'guarded' and not math.isfinite(width)):
            return 'undecided'
        guard = width if rule == 'guarded' else 0.0
        if self.lower + guard <= value <= self.upper - guard:
            return 'pass'
        outside = value > self.upper + guard or value < self.lower - guard
        return 'fail' if outside else 'undecided'


@dataclass(frozen=True)
class CoefficientLimits:
    """The limits of a file and the rule by which they are decided."""

    sensors: Mapping[str, Mapping[str, CoefficientLimit]]
    """By sensor, then by `bias`, `slope` or the name of an effect."""
    rule: Rule = 'guarded'
    source: str = ''
    """Where the limits come from; '' where the file does not say."""

    def of(self, sensor: str, coefficient: str) -> CoefficientLimit | None:
        """Return the limit of a sensor's coefficient, None where there is none."""
        return self.sensors.get(sensor, {}).get(coefficient)


def read_limits(path: Path) -> CoefficientLimits:
    """Return the limits of a YAML file (`schemas/limits.json`) in SI units.

    Raises UserError that names the file, the limit and what is expected.
    """
    content = read_checked(path, 'limits.json')
    sensors = {
        sensor: {
            name: _limit(f'{path}: {sensor}.{name}', sensor, name, given)
            for name, given in named.items()
        }
        for sensor, named in content['limits'].items()
    }
    return CoefficientLimits(sensors, content.get('rule', 'guarded'), content.get('source', ''))


def _limit(
    place: str, sensor: str, name: str, given: Mapping[str, float | str]
) -> CoefficientLimit:
    factor, suffix = _converted(place, sensor, str(given['unit']))
    expected = UNIT_SUFFIXES.get(name, suffix)
    if suffix != expected:
        raise UserError(
            f'{place}: unit {given["unit"]!r}; a {name} has one like '
            f'{SENSOR_UNITS[sensor]}{expected}'
        )
    lower = float(given.get('lower', -math.inf)) * factor
    upper = float(given.get('upper', math.inf)) * factor
    if lower > upper:
        raise UserError(f'{place}: lower {given["lower"]} is above upper {given["upper"]}')
    return CoefficientLimit(lower, upper, f'{SENSOR_UNITS[sensor]}{suffix}')


def _converted(place: str, sensor: str, unit: str) -> tuple[float, str]:
    """Return the factor to SI and what stands behind the sensor's unit.

    >>> _converted('', 'accelerometer', 'mg/K')
    (0.00980665, '/K')
    """
    known = SI_FACTORS[sensor]
    for name in sorted(known, key=len, reverse=True):
        rest = unit.removeprefix(name)
        if unit.startswith(name) and rest[:1] in ('', '/', '·'):
            return known[name], rest
    raise UserError(
        f'{place}: unit {unit!r} is none of the {sensor}; known: {", ".join(known)}, with /K and '
        'the like behind'
    )
