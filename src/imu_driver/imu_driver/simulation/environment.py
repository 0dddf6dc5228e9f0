# SPDX-License-Identifier: Apache-2.0
"""Environment of a simulated device: air, chamber, supply, vibration, gravity and fields."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from imu_driver.simulation.noise import ou_process

LATITUDE = np.deg2rad(41.5)
"""Of the simulated laboratory [rad]."""
LOCAL_GRAVITY = 9.8033
"""Gravity in the simulated laboratory [m/s²] at LATITUDE, sea level (WGS 84)."""
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


@dataclass(frozen=True, eq=False)
class Environment:
    """Environment of a device as columns (n,), equally spaced in time."""

    time: FloatArray
    """[s] since the start."""
    air_temperature: FloatArray
    """True air at the device [°C]."""
    chamber_temperature: FloatArray | None = None
    """First PT100 [°C]. This and the tracks up to `cycle` are what a chamber reports."""
    chamber_temperature_2: FloatArray | None = None
    setpoint: FloatArray | None = None
    heater: FloatArray | None = None
    compressor: FloatArray | None = None
    fan: FloatArray | None = None
    humidity: FloatArray | None = None
    phase: IntArray | None = None
    cycle: IntArray | None = None
    profile: str = ''
    free_stream: FloatArray | None = None
    """Air beside a device that is sheltered from it [°C]; None: the same as at the device."""
    gravity: float = LOCAL_GRAVITY
    """[m/s²]"""
    magnetic_field: FloatArray = field(default_factory=lambda: MAGNETIC_FIELD)
    """(3,) ENU [T]."""
    earth_rate: FloatArray = field(default_factory=lambda: EARTH_RATE)
    """(3,) ENU [rad/s]."""

    @property
    def period(self) -> float:
        """Step of time [s]."""
        return float(self.time[1] - self.time[0])

    def column(self, name: str, absent: float = 0.0) -> FloatArray:
        """Return a chamber track, or a constant where there is no such track."""
        value: FloatArray | None = getattr(self, name)
        return np.full(len(self.time), absent) if value is None else value


def constant_environment(air: float, duration: float, *, period: float = 1.0) -> Environment:
    """Return an environment of still air of one temperature [°C] for `duration` seconds."""
    time = np.arange(0.0, duration + period / 2, period)
    return Environment(time, np.full(len(time), air))


def supply_voltage(
    environment: Environment, nominal: float, generator: np.random.Generator
) -> FloatArray:
    """Return (n,) the device's supply [V]: regulator wander, droop while the compressor runs.

    The wander is an Ornstein–Uhlenbeck process of 3 mV and 20 min; mains load shifts the supply
    by 4 mV over the compressor's 40 s rise, unequal from start to start.
    """
    n, period = len(environment.time), environment.period
    wander = 3e-3 * ou_process(n, period, 1200.0, generator)
    load = low_pass(environment.column('compressor'), 40.0, period)
    varying = 1.0 + 0.4 * ou_process(n, period, 900.0, generator)
    voltage: FloatArray = nominal + wander - 4e-3 * load * varying
    return voltage


def vibration_variance(environment: Environment, generator: np.random.Generator) -> FloatArray:
    """Return (n, 3) variance of the chamber's vibration at the device [(m/s²)²].

    Compressor (20 mm/s² rms, load dependent) and fan (5 mm/s²); the mount transmits the axes
    unequally, and the running-in of each compressor start shows.
    """
    n, period = len(environment.time), environment.period
    load = 1.0 + 0.35 * ou_process(n, period, 300.0, generator)
    running_in = 1.0 - low_pass(environment.column('compressor'), 120.0, period)
    compressor = environment.column('compressor') * load**2 * (1.0 + running_in)
    total = 4e-4 * compressor + 2.5e-5 * environment.column('fan')
    share = np.array([0.8, 1.0, 1.2])
    variance: FloatArray = np.multiply.outer(total, share)
    return variance


def low_pass(values: FloatArray, time_constant: float, period: float) -> FloatArray:
    """Return (n, …) a first-order low-pass of values, at rest at the first of them."""
    from scipy.signal import lfilter

    decay = np.exp(-period / time_constant)
    start = decay * values[:1]
    filtered: FloatArray = lfilter([1.0 - decay], [1.0, -decay], values, axis=0, zi=start)[0]
    return filtered
