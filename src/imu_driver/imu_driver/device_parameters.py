# SPDX-License-Identifier: Apache-2.0
"""What a simulated nine-axis device is made of: three triads, a thermometer, a clock, a board."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from imu_recording.recording import FloatArray

from imu_driver.lsm9ds1 import DEGREE

REFERENCE_TEMPERATURE = 20.0
"""Levels hold at this die temperature [°C]."""
SENSOR_RATE = 14.9
"""Output data rate of the sensor behind a slower read-out [Hz] (LSM9DS1, lowest)."""

MEAN_STD = {'accelerometer': 1.04e-3, 'gyroscope': 7.1e-3 * DEGREE, 'magnetometer': 0.10e-6}
"""Standard deviation of a one-second mean of an LSM9DS1-class sensor, white part [SI unit]."""
BIAS_INSTABILITY = {
    name: value * part
    for (name, value), part in zip(MEAN_STD.items(), (0.42, 0.69, 0.37), strict=True)
}
"""B of the flicker noise of the class [SI unit], S(f) = B²/(2πf) (IEEE 952)."""

LATITUDE = np.deg2rad(41.5)
GRAVITY = 9.8033
"""Local gravity of the simulated laboratory [m/s²] at LATITUDE, sea level (WGS 84)."""
EARTH_RATE = 7.292115e-5 * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])
"""(3,) ENU [rad/s]."""
MAGNETIC_FIELD = 46.5e-6 * np.array(
    [
        np.cos(np.deg2rad(58.0)) * np.sin(np.deg2rad(3.5)),
        np.cos(np.deg2rad(58.0)) * np.cos(np.deg2rad(3.5)),
        -np.sin(np.deg2rad(58.0)),
    ]
)
"""(3,) ENU [T]: 46.5 µT, inclination 58°, declination 3.5° east."""


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
    field_levels: FloatArray = field(default_factory=lambda: np.zeros((4, 3)))
    """(cycles, 3) level of the magnetic field in R1 … R4 above R1 [T], for --field-jumps."""

    def sensor(self, name: str) -> SensorParameters:
        """Return the parameters of one triad."""
        parameters: SensorParameters = getattr(self, name)
        return parameters
