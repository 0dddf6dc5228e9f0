# SPDX-License-Identifier: Apache-2.0
"""Parameters of PX4's thermal compensation, as QGroundControl loads them.

TC_A0_X3_0 is the coefficient of (T − TC_A0_TREF)³ of accelerometer 0, x axis [m/s²/K³], TC_G…
those of gyroscopes [rad/s …]; PX4 subtracts the polynomial and holds T between TMIN and TMAX
(module temperature_compensation). Coefficients belong to the sensor whose device ID is TC_A0_ID.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from thermal_comp.data.conditions import Sensor
from thermal_comp.export.cubic import POLYNOMIAL_ORDER, Cubic
from thermal_comp.model.values import ModelError

SENSOR_LETTERS: Mapping[Sensor, str] = {'accelerometer': 'A', 'gyroscope': 'G'}
"""Sensors in the names of parameters."""
INSTANCES = range(4)
"""Instances of a sensor that have parameters."""
INTEGER_TYPE, REAL_TYPE = 6, 9
"""MAV_PARAM_TYPE_INT32 and _REAL32 of MAVLink."""


def px4_text(
    cubics: Mapping[Sensor, Cubic], instance: int, ids: Mapping[Sensor, int], label: str
) -> str:
    """Return the parameter file; `instance` counts from 0, `ids` are the sensors' device IDs."""
    rows: list[tuple[str, str, int]] = []
    for sensor, letter in SENSOR_LETTERS.items():
        if sensor not in cubics:
            continue
        cubic, prefix = cubics[sensor], f'TC_{letter}{instance}'
        rows.append((f'TC_{letter}_ENABLE', '1', INTEGER_TYPE))
        if sensor in ids:
            rows.append((f'{prefix}_ID', str(ids[sensor]), INTEGER_TYPE))
        reals = {'TMIN': cubic.low, 'TMAX': cubic.high, 'TREF': cubic.reference}
        for power in range(POLYNOMIAL_ORDER + 1):
            for axis in range(3):
                reals[f'X{power}_{axis}'] = float(cubic.coefficients[power, axis])
        rows += [(f'{prefix}_{name}', shortest(value), REAL_TYPE) for name, value in reals.items()]
    lines = [f'# Thermal compensation: {label}', '#', '# Vehicle-Id Component-Id Name Value Type']
    lines += [f'1\t1\t{name}\t{value}\t{kind}' for name, value, kind in rows]
    return '\n'.join(lines) + '\n'


def read_px4(text: str, instance: int) -> dict[Sensor, Cubic]:
    """Return the polynomials of one instance of a parameter file."""
    values: dict[str, float] = {}
    for line in text.splitlines():
        cells = line.split('\t')
        if len(cells) == 5 and not line.startswith('#'):
            values[cells[2]] = float(cells[3])
    cubics: dict[Sensor, Cubic] = {}
    for sensor, letter in SENSOR_LETTERS.items():
        prefix = f'TC_{letter}{instance}'
        if f'{prefix}_TREF' not in values:
            continue
        try:
            powers = [
                [values[f'{prefix}_X{k}_{axis}'] for axis in range(3)]
                for k in range(POLYNOMIAL_ORDER + 1)
            ]
            low, high = values[f'{prefix}_TMIN'], values[f'{prefix}_TMAX']
        except KeyError as missing:
            raise ModelError(f'{missing.args[0]}: missing') from None
        cubics[sensor] = Cubic(
            coefficients=np.array(powers), reference=values[f'{prefix}_TREF'], low=low, high=high
        )
    return cubics


def shortest(value: float) -> str:
    """Return the fewest digits that single precision reads back alike, without exponent.

    >>> shortest(0.1), shortest(-1.5e-9), shortest(35.0)
    ('0.1', '-0.0000000015', '35.0')
    """
    return np.format_float_positional(np.float32(value), trim='0')
