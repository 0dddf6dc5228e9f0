# SPDX-License-Identifier: Apache-2.0
"""The LSM9DS1 as tables: full scales, sensitivities, rates, registers, limits, axes.

Source of every number, unless its comment says otherwise: STMicroelectronics, LSM9DS1 datasheet
DocID025715 Rev 3, with the number of its table. Register names are ST's, used in this file only.

>>> round(SENSITIVITY['accelerometer'][16.0] / STANDARD_GRAVITY * 1e3, 3)  # mg/LSB, not 0.488
0.732
>>> temperature_from_counts(-80)
20.0
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from imu_recording.recording import STANDARD_GRAVITY, TESLA_PER_GAUSS, FloatArray
from imu_recording.user_error import UserError

RADIANS_PER_DEGREE: Final = math.pi / 180.0
"""[rad] in one degree."""

SENSORS: Final = ('gyroscope', 'accelerometer', 'magnetometer')
"""In the order of the wire's counts."""

FULL_SCALE_UNITS: Final = {'gyroscope': 'dps', 'accelerometer': 'g', 'magnetometer': 'gauss'}

SENSITIVITY: Final[dict[str, dict[float, float]]] = {
    'gyroscope': {  # table 3, G_So [mdps/LSB] → [rad/s/LSB]
        245.0: 8.75e-3 * RADIANS_PER_DEGREE,
        500.0: 17.50e-3 * RADIANS_PER_DEGREE,
        2000.0: 70.0e-3 * RADIANS_PER_DEGREE,
    },
    'accelerometer': {  # table 3, LA_So [mg/LSB] → [m/s²/LSB]; 16 g is no power of two
        2.0: 0.061e-3 * STANDARD_GRAVITY,
        4.0: 0.122e-3 * STANDARD_GRAVITY,
        8.0: 0.244e-3 * STANDARD_GRAVITY,
        16.0: 0.732e-3 * STANDARD_GRAVITY,
    },
    'magnetometer': {  # table 3, M_GN [mgauss/LSB] → [T/LSB]
        4.0: 0.14e-3 * TESLA_PER_GAUSS,
        8.0: 0.29e-3 * TESLA_PER_GAUSS,
        12.0: 0.43e-3 * TESLA_PER_GAUSS,
        16.0: 0.58e-3 * TESLA_PER_GAUSS,
    },
}
"""SI units per count for each selectable full scale in datasheet units (FULL_SCALE_UNITS)."""

FULL_SCALE_CODES: Final[dict[str, dict[float, int]]] = {
    'gyroscope': {245.0: 0b00, 500.0: 0b01, 2000.0: 0b11},  # table 46
    'accelerometer': {2.0: 0b00, 16.0: 0b01, 4.0: 0b10, 8.0: 0b11},  # table 67: 01 is 16 g
    'magnetometer': {4.0: 0b00, 8.0: 0b01, 12.0: 0b10, 16.0: 0b11},  # table 114
}
"""Full scale → bits FS of CTRL_REG1_G, CTRL_REG6_XL, CTRL_REG2_M."""

DEFAULT_FULL_SCALE: Final = {'gyroscope': 245.0, 'accelerometer': 2.0, 'magnetometer': 4.0}
"""After power-on: the most sensitive of each."""

COUNT_MIN: Final = -32768
COUNT_MAX: Final = 32767

OUTPUT_DATA_RATES: Final[dict[float, int]] = {  # table 46, ODR_G: gyroscope and accelerometer
    14.9: 0b001,
    59.5: 0b010,
    119.0: 0b011,
    238.0: 0b100,
    476.0: 0b101,
    952.0: 0b110,
}
"""[Hz] → bits ODR of CTRL_REG1_G and CTRL_REG6_XL; both sensors run at the gyroscope's rate."""

MAGNETOMETER_RATES: Final[dict[float, int]] = {  # table 111
    0.625: 0b000,
    1.25: 0b001,
    2.5: 0b010,
    5.0: 0b011,
    10.0: 0b100,
    20.0: 0b101,
    40.0: 0b110,
    80.0: 0b111,
}
"""[Hz] → bits DO of CTRL_REG1_M."""

TEMPERATURE_RATE_HZ: Final = 59.5
"""[Hz] Refresh of the temperature register while the gyroscope runs (table 5)."""
TEMPERATURE_SENSITIVITY_C: Final = 1.0 / 16.0
"""[°C/LSB] (table 5)."""
ZERO_COUNT_TEMPERATURE_C: Final = 25.0
"""[°C] at count 0 (table 5, typical; absolute accuracy is not specified)."""

SUPPLY_VOLTAGE_RANGE_V: Final = (1.9, 3.6)
"""[V] Vdd, minimum and maximum (table 4)."""
OPERATING_TEMPERATURE_RANGE_C: Final = (-40.0, 85.0)
"""[°C] minimum and maximum (table 4)."""

AXIS_SIGNS: Final[dict[str, tuple[int, int, int]]] = {
    'gyroscope': (1, 1, 1),
    'accelerometer': (1, 1, 1),
    'magnetometer': (-1, 1, 1),
}
"""Sign of each output that puts all three sensors into one right-handed frame.

The magnetometer's x axis points against the other two sensors' x axis (datasheet figure 1,
"Pin connections"; PX4 DriverFramework pull request 160 found it on hardware).
"""

WHO_AM_I: Final = {'accelerometer_gyroscope': 0x68, 'magnetometer': 0x3D}  # register 0x0F of both

ACCELEROMETER_GYROSCOPE_REGISTERS: Final = {  # table 21, what the dump holds, in its order
    'CTRL_REG1_G': 0x10,
    'CTRL_REG2_G': 0x11,
    'CTRL_REG3_G': 0x12,
    'ORIENT_CFG_G': 0x13,
    'CTRL_REG4': 0x1E,
    'CTRL_REG5_XL': 0x1F,
    'CTRL_REG6_XL': 0x20,
    'CTRL_REG7_XL': 0x21,
    'CTRL_REG8': 0x22,
    'CTRL_REG9': 0x23,
    'CTRL_REG10': 0x24,
}
MAGNETOMETER_REGISTERS: Final = {  # table 22
    'CTRL_REG1_M': 0x20,
    'CTRL_REG2_M': 0x21,
    'CTRL_REG3_M': 0x22,
    'CTRL_REG4_M': 0x23,
    'CTRL_REG5_M': 0x24,
}
REGISTERS: Final = (*ACCELEROMETER_GYROSCOPE_REGISTERS, *MAGNETOMETER_REGISTERS)
"""Names of the registers of a dump, in the order of its bytes."""

TEMP_COMP_BIT: Final = 0x80
"""Bit of CTRL_REG1_M: the magnetometer compensates its own temperature error (table 109)."""


def register_set_up(
    full_scale: dict[str, float],
    output_data_rate: float,
    *,
    magnetometer_rate: float = 80.0,
    magnetometer_temperature_compensation: bool = False,
) -> dict[str, int]:
    """Return the value of every register of REGISTERS for a measuring device.

    Continuous conversion, all axes on, block data update, automatic address increment, no
    high-pass filter, the magnetometer in ultra-high-performance mode on all axes.
    """
    rate = OUTPUT_DATA_RATES[output_data_rate] << 5
    code = {sensor: FULL_SCALE_CODES[sensor][full_scale[sensor]] for sensor in SENSORS}
    compensation = TEMP_COMP_BIT if magnetometer_temperature_compensation else 0
    return {
        'CTRL_REG1_G': rate | code['gyroscope'] << 3,
        'CTRL_REG2_G': 0x00,
        'CTRL_REG3_G': 0x00,
        'ORIENT_CFG_G': 0x00,
        'CTRL_REG4': 0x38,  # Zen_G, Yen_G, Xen_G
        'CTRL_REG5_XL': 0x38,  # Zen_XL, Yen_XL, Xen_XL
        'CTRL_REG6_XL': rate | code['accelerometer'] << 3,
        'CTRL_REG7_XL': 0x00,
        'CTRL_REG8': 0x44,  # BDU, IF_ADD_INC
        'CTRL_REG9': 0x00,
        'CTRL_REG10': 0x00,
        'CTRL_REG1_M': compensation | 0x60 | MAGNETOMETER_RATES[magnetometer_rate] << 2,  # OM
        'CTRL_REG2_M': code['magnetometer'] << 5,
        'CTRL_REG3_M': 0x00,  # MD: continuous
        'CTRL_REG4_M': 0x0C,  # OMZ
        'CTRL_REG5_M': 0x40,  # BDU
    }


def compensates_magnetometer_temperature(registers: Sequence[int]) -> bool:
    """Return whether a dump (REGISTERS) has the magnetometer compensate its temperature error."""
    return bool(registers[REGISTERS.index('CTRL_REG1_M')] & TEMP_COMP_BIT)


def nearest_rate(rate_hz: float) -> float:
    """Return the selectable gyroscope and accelerometer rate nearest to one asked for [Hz]."""
    return min(OUTPUT_DATA_RATES, key=lambda rate: abs(math.log(rate / rate_hz)))


def temperature_from_counts(counts: int) -> float:
    """Return the die temperature [°C] of a temperature count."""
    return ZERO_COUNT_TEMPERATURE_C + counts * TEMPERATURE_SENSITIVITY_C


def scale(sensor: str, full_scale: float) -> FloatArray:
    """Return (3,) SI units per count, signed so that the axes are the right-handed frame's.

    Raises UserError where the sensor has no such full scale.
    """
    try:
        sensitivity = SENSITIVITY[sensor][full_scale]
    except KeyError:
        choices = ', '.join(f'{value:g}' for value in SENSITIVITY[sensor])
        raise UserError(
            f'{sensor} full scale {full_scale:g} {FULL_SCALE_UNITS[sensor]} does not exist; '
            f'selectable: {choices}'
        ) from None
    return sensitivity * np.array(AXIS_SIGNS[sensor], dtype=float)
