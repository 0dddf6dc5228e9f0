# SPDX-License-Identifier: Apache-2.0
"""Parameters of ArduPilot's IMU temperature calibration, one NAME VALUE a line.

INS_TCAL1_ACC2_X is 10⁶ times the coefficient of (T − 35 °C)² of the first IMU's accelerometer, x
axis [m/s²/K²]; GYR… those of the gyroscope [rad/s …]. ArduPilot subtracts the polynomial at T less
that at the temperature of the offset calibration (INS_ACC1_CALTEMP, INS_GYR1_CALTEMP), so that
there is no constant, and holds T between TMIN and TMAX (AP_InertialSensor_tempcal).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from thermal_comp.data.conditions import Sensor
from thermal_comp.export.cubic import POLYNOMIAL_ORDER, Cubic
from thermal_comp.export.px4 import shortest
from thermal_comp.model.values import ModelError

SENSOR_NAMES: Mapping[Sensor, str] = {'accelerometer': 'ACC', 'gyroscope': 'GYR'}
"""Sensors in the names of parameters."""
REFERENCE_TEMPERATURE = 35.0
"""[°C]."""
PARAMETER_PER_COEFFICIENT = 1e6
"""Parameter over coefficient."""
LOWEST_C, HIGHEST_C = -70.0, 80.0
"""Least TMIN and greatest TMAX [°C]."""


def ardupilot_text(cubics: Mapping[Sensor, Cubic], instance: int, label: str) -> str:
    """Return the parameter file; `instance` counts from 0, ArduPilot's names from 1.

    Both sensors share TMIN and TMAX: the range that both were fitted in.
    """
    known = {sensor: cubics[sensor] for sensor in SENSOR_NAMES if sensor in cubics}
    low = max([LOWEST_C, *(c.low for c in known.values())])
    high = min([HIGHEST_C, *(c.high for c in known.values())])
    prefix = f'INS_TCAL{instance + 1}'
    lines = [
        f'# IMU temperature calibration: {label}',
        f'{prefix}_ENABLE 1',
        f'{prefix}_TMIN {shortest(low)}',
        f'{prefix}_TMAX {shortest(high)}',
    ]
    for sensor, name in SENSOR_NAMES.items():
        scaled = np.zeros((POLYNOMIAL_ORDER + 1, 3))
        if sensor in known:
            scaled = (
                PARAMETER_PER_COEFFICIENT * known[sensor].about(REFERENCE_TEMPERATURE).coefficients
            )
        lines += [
            f'{prefix}_{name}{power}_{axis} {shortest(float(scaled[power, k]))}'
            for power in range(1, POLYNOMIAL_ORDER + 1)
            for k, axis in enumerate('XYZ')
        ]
    return '\n'.join(lines) + '\n'


def read_ardupilot(text: str, instance: int) -> dict[Sensor, Cubic]:
    """Return the polynomials of one IMU of a parameter file, zero at 35 °C."""
    lines = (line.replace(',', ' ').split() for line in text.splitlines())
    values = {cells[0]: float(cells[1]) for cells in lines if cells and cells[0][0] != '#'}
    prefix = f'INS_TCAL{instance + 1}'
    cubics: dict[Sensor, Cubic] = {}
    for sensor, name in SENSOR_NAMES.items():
        try:
            powers = [
                [
                    values[f'{prefix}_{name}{power}_{axis}'] / PARAMETER_PER_COEFFICIENT
                    for axis in 'XYZ'
                ]
                for power in range(1, POLYNOMIAL_ORDER + 1)
            ]
            low, high = values[f'{prefix}_TMIN'], values[f'{prefix}_TMAX']
        except KeyError as missing:
            raise ModelError(f'{missing.args[0]}: missing') from None
        coefficients = np.vstack([np.zeros((1, 3)), powers])
        cubics[sensor] = Cubic(
            coefficients=coefficients, reference=REFERENCE_TEMPERATURE, low=low, high=high
        )
    return cubics
