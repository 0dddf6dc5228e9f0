# SPDX-License-Identifier: Apache-2.0
"""Simulated nine-axis devices: their parameters, DUT1 … DUT3 of Betta et al. (2022), drawn ones.

Source of DUT1 … DUT3: Tables III–V. Spread (σ) and level (mean) of each axis are those of the
first cycle (R1) of the device's table; the other columns cannot be cycles of the same device, as
they repeat across devices and jump in field. Signs of the slopes follow Fig. 5 where it shows
them (magnetometer x of DUT1 against DUT2) and are chosen elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from imu_recording.recording import FloatArray
from imu_recording.user_error import UserError

from imu_driver.board.lsm9ds1 import DEFAULT_FULL_SCALE, RADIANS_PER_DEGREE, SENSITIVITY
from imu_driver.simulation.environment import LOCAL_GRAVITY, MAGNETIC_FIELD

REFERENCE_TEMPERATURE = 20.0
"""Die temperature at which biases and scale errors are given [°C]."""
SENSOR_RATE_HZ = 14.9
"""Output data rate of the sensor behind a slower read-out [Hz] (LSM9DS1, lowest)."""

MEAN_STD = {
    'accelerometer': 1.04e-3,
    'gyroscope': 7.1e-3 * RADIANS_PER_DEGREE,
    'magnetometer': 0.10e-6,
}
"""Standard deviation of a one-second mean of an LSM9DS1-class sensor, white part [SI unit]."""
BIAS_INSTABILITY = {
    name: value * part
    for (name, value), part in zip(MEAN_STD.items(), (0.42, 0.69, 0.37), strict=True)
}
"""B of the flicker noise of the class [SI unit], S(f) = B²/(2πf) (IEEE 952)."""


class ThermalNetwork(NamedTuple):
    """Heat capacities [J/K], conductances [W/K] and powers [W] of a small sensor board.

    Silicon dies on one substrate follow the package within 0.1 s, the package the board within
    1 s, the 6 g board the air within two minutes.
    """

    board_capacity: float = 9.0
    package_capacity: float = 0.035
    die_capacity: float = 0.004
    magnetometer_capacity: float = 0.0015
    air_to_board: float = 0.08
    """At `convection_difference` between air and board."""
    air_to_package: float = 0.002
    board_to_package: float = 0.05
    package_to_die: float = 0.06
    package_to_magnetometer: float = 0.03
    board_power: float = 0.015
    die_power: float = 0.014
    magnetometer_power: float = 0.0006
    convection_difference: float = 2.0
    """[K]"""
    convection_exponent: float = 0.10
    """Forced convection 0, laminar natural convection 0.25."""


@dataclass(frozen=True, eq=False)
class SensorParameters:
    """Error sources of one triad, SI units, (3,) per axis unless said otherwise."""

    bias: FloatArray
    """At the reference temperature."""
    slope: FloatArray
    """Change of bias per kelvin at the reference temperature."""
    mean_std: FloatArray
    """White noise: standard deviation of a one-second mean."""
    bias_instability: float
    """B of the flicker noise, every axis."""
    sensitivity: float
    """SI unit per count."""
    stiffening: float = 1e-5
    """Relative change of the slope per kelvin: how fast expansion coefficients grow [1/K]."""
    scale_error: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Relative."""
    scale_slope: float = 2e-7
    """Relative change of scale per kelvin, every axis [1/K]."""
    misalignment: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Small rotation of the triad against the package [rad]."""
    turn_on_std: float = 0.0
    """Spread of the bias from one power-on to the next."""
    supply_slope: float = 0.0
    """Change of bias per volt of supply."""


@dataclass(frozen=True, eq=False)
class DeviceParameters:
    """One device: three triads, thermometer, clock, supply, thermal network."""

    name: str
    accelerometer: SensorParameters
    gyroscope: SensorParameters
    magnetometer: SensorParameters
    network: ThermalNetwork = field(default_factory=ThermalNetwork)
    thermometer_offset: float = 0.0
    """[K]"""
    thermometer_gain: float = 0.0
    """Relative."""
    thermometer_noise: float = 0.04
    """Standard deviation of one reading before rounding to 1/16 K [K]."""
    rate_error: float = 0.0
    """Relative error of the output data rate at the reference temperature."""
    rate_slope: float = 0.0
    """Relative change of the output data rate per kelvin [1/K]."""
    supply_voltage: float = 3.3
    """[V]"""
    g_sensitivity: float = 1e-5
    """Change of angular rate per specific force, every axis pair [rad/s per m/s²]."""
    glue_conductance: float = 1.0
    """Conductance of the glue under the elements relative to a new device's: lags go with 1/it."""
    field_levels: FloatArray = field(default_factory=lambda: np.zeros((4, 3)))
    """(cycles, 3) level of the magnetic field in R1 … R4 above R1 [T], for --field-jumps."""

    def sensor(self, name: str) -> SensorParameters:
        """Return the parameters of one triad."""
        parameters: SensorParameters = getattr(self, name)
        return parameters


CYCLE_TEMPERATURE_STD = 21.8
"""Standard deviation of the die's temperature over one cycle of the paper's plan [K]."""


@dataclass(frozen=True)
class _Table:
    """Tables III–V of one device, printed units: dps, m/s², µT; axes x, y, z."""

    up: int
    """Axis toward gravity."""
    gyroscope_mean: tuple[float, ...]
    gyroscope_spread: tuple[float, ...]
    """Negative: falls with temperature."""
    gyroscope_noise: tuple[float, ...]
    """Reference σ. The table's 0.00 is below 0.005, its 0.03 a misprint (the range is 0.01)."""
    accelerometer_mean: tuple[float, ...]
    accelerometer_spread: tuple[float, ...]
    magnetometer_mean: tuple[tuple[float, ...], ...]
    """R1 … R4."""
    magnetometer_spread: tuple[float, ...]


_TABLES = {
    'dut1': _Table(
        up=0,
        gyroscope_mean=(0.05, 0.00, -0.03),
        gyroscope_spread=(0.04, 0.06, -0.01),
        gyroscope_noise=(0.005, 0.009, 0.005),
        accelerometer_mean=(9.71, 0.04, -0.35),
        accelerometer_spread=(0.24, -0.14, 0.28),
        magnetometer_mean=(
            (-43.67, -7.19, -13.00),
            (-79.51, 12.91, 141.76),
            (-60.63, -24.22, -108.10),
            (-58.98, -27.44, -119.01),
        ),
        magnetometer_spread=(-6.43, 4.97, -6.83),
    ),
    'dut2': _Table(
        up=1,
        gyroscope_mean=(-0.02, -0.08, -0.01),
        gyroscope_spread=(-0.07, 0.09, 0.03),
        gyroscope_noise=(0.009, 0.009, 0.009),
        accelerometer_mean=(0.06, 9.79, 0.39),
        accelerometer_spread=(-0.11, 0.16, -0.18),
        magnetometer_mean=(
            (-31.61, -24.47, 13.46),
            (-27.29, 8.63, 83.52),
            (-36.41, -12.48, -7.28),
            (-26.52, 40.30, -23.71),
        ),
        magnetometer_spread=(11.15, -10.40, 4.94),
    ),
    'dut3': _Table(
        up=2,
        gyroscope_mean=(-0.01, -0.08, 0.05),
        gyroscope_spread=(0.06, -0.08, -0.04),
        gyroscope_noise=(0.005, 0.009, 0.005),
        accelerometer_mean=(-0.51, 0.18, 9.65),
        accelerometer_spread=(0.04, 0.14, -0.12),
        magnetometer_mean=(
            (-0.44, 36.04, -5.99),
            (6.36, -34.77, 71.36),
            (1.78, -43.92, 21.18),
            (-21.51, -39.81, -11.65),
        ),
        magnetometer_spread=(10.92, 14.62, -6.98),
    ),
}


def _slope(spread: tuple[float, ...], noise: FloatArray, unit: float) -> FloatArray:
    """Return the slope whose spread over a cycle together with the noise is the table's."""
    printed = np.array(spread) * unit
    thermal = np.sqrt(np.maximum(printed**2 - noise**2, 0.0))
    slope: FloatArray = np.sign(printed) * thermal / CYCLE_TEMPERATURE_STD
    return slope


def _device(name: str, table: _Table, seed: int) -> DeviceParameters:
    """Return the device of one table; parameters the tables do not give are drawn."""
    draw = np.random.default_rng(seed)
    micro = 1e-6
    noise = {key: np.full(3, value) for key, value in MEAN_STD.items()}
    noise['gyroscope'] = (
        np.array(table.gyroscope_noise) * RADIANS_PER_DEGREE / np.sqrt(SENSOR_RATE_HZ)
    )
    sample = {key: value * np.sqrt(SENSOR_RATE_HZ) for key, value in noise.items()}
    up = np.roll(np.array([0.0, 0.0, 1.0]), table.up + 1)
    seen = np.roll(MAGNETIC_FIELD, table.up + 1)
    levels = np.array(table.magnetometer_mean) * micro
    triad = {
        'accelerometer': (
            np.array(table.accelerometer_mean) - LOCAL_GRAVITY * up,
            _slope(table.accelerometer_spread, sample['accelerometer'], 1.0),
        ),
        'gyroscope': (
            np.array(table.gyroscope_mean) * RADIANS_PER_DEGREE,
            _slope(table.gyroscope_spread, sample['gyroscope'], RADIANS_PER_DEGREE),
        ),
        'magnetometer': (
            levels[0] - seen,
            _slope(table.magnetometer_spread, sample['magnetometer'], micro),
        ),
    }
    return DeviceParameters(
        name=name,
        accelerometer=_sensor('accelerometer', *triad['accelerometer'], noise, draw),
        gyroscope=replace(
            _sensor('gyroscope', *triad['gyroscope'], noise, draw),
            bias_instability=2.0e-3 * RADIANS_PER_DEGREE,
        ),
        magnetometer=_sensor('magnetometer', *triad['magnetometer'], noise, draw),
        thermometer_offset=float(draw.normal(0.0, 0.8)),
        thermometer_gain=float(draw.normal(0.0, 0.003)),
        rate_error=float(draw.normal(0.0, 2e-3)),
        rate_slope=float(draw.choice([-1.0, 1.0]) * draw.uniform(20e-6, 60e-6)),
        field_levels=levels - levels[0],
    )


_TURN_ON_STD = {
    'accelerometer': 5e-3,
    'gyroscope': 2e-3 * RADIANS_PER_DEGREE,
    'magnetometer': 0.1e-6,
}
_SUPPLY_SENSITIVITY = {
    'accelerometer': 2e-3,
    'gyroscope': 10e-3 * RADIANS_PER_DEGREE,
    'magnetometer': 0.2e-6,
}


def _sensor(
    name: str,
    bias: FloatArray,
    slope: FloatArray,
    noise: dict[str, FloatArray],
    draw: np.random.Generator,
) -> SensorParameters:
    return SensorParameters(
        bias=bias,
        slope=slope,
        mean_std=noise[name],
        bias_instability=BIAS_INSTABILITY[name],
        sensitivity=SENSITIVITY[name][DEFAULT_FULL_SCALE[name]],
        scale_error=draw.normal(0.0, 3e-3, 3),
        misalignment=draw.normal(0.0, 3e-3, 3),
        turn_on_std=_TURN_ON_STD[name],
        supply_slope=_SUPPLY_SENSITIVITY[name] * float(draw.choice([-1.0, 1.0])),
    )


TYPICAL_STD = {
    'accelerometer': (0.15, 2.5e-3),
    'gyroscope': (1.0 * RADIANS_PER_DEGREE, 15e-3 * RADIANS_PER_DEGREE),
    'magnetometer': (8e-6, 0.1e-6),
}
"""Standard deviation of bias [SI unit] and of its slope [SI unit/K] over devices of the class."""


def draw_device(seed: int | tuple[int, ...]) -> DeviceParameters:
    """Return a device of the LSM9DS1's class, every parameter drawn from its usual spread."""
    key = (seed,) if isinstance(seed, int) else seed
    draw = np.random.default_rng((*key, 9))
    noise = {name: np.full(3, value) for name, value in MEAN_STD.items()}
    triad = {
        name: _sensor(name, draw.normal(0.0, bias, 3), draw.normal(0.0, slope, 3), noise, draw)
        for name, (bias, slope) in TYPICAL_STD.items()
    }
    return DeviceParameters(
        name='drawn' + '_'.join(map(str, key)),
        accelerometer=triad['accelerometer'],
        gyroscope=triad['gyroscope'],
        magnetometer=triad['magnetometer'],
        thermometer_offset=float(draw.normal(0.0, 0.8)),
        thermometer_gain=float(draw.normal(0.0, 0.003)),
        rate_error=float(draw.normal(0.0, 2e-3)),
        rate_slope=float(draw.normal(0.0, 40e-6)),
    )


DEVICES: dict[str, DeviceParameters] = {
    name: _device(name, table, seed)
    for seed, (name, table) in enumerate(_TABLES.items(), start=11)
}
"""dut1 … dut3."""


def find_device(device: str | DeviceParameters) -> DeviceParameters:
    """Return the parameters of a device by name."""
    if isinstance(device, DeviceParameters):
        return device
    try:
        return DEVICES[device]
    except KeyError:
        raise UserError(
            f'there is no simulated device {device!r}; there are {", ".join(DEVICES)}'
        ) from None
