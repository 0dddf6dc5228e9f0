# SPDX-License-Identifier: Apache-2.0
"""A population of simulated devices: lots with means and covariances of their own, and outliers.

A device is one of the class (`draw_device`) whose slopes over temperature come from its lot: the
mean of the type, plus what its lot shares, plus what is its own. Which devices carry a further
effect of the simulator is drawn with the prevalence of their lot; the effect has one shape in a
lot and a size of its own in each device.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray
from imu_recording.user_error import UserError

from imu_driver.simulation.devices import TYPICAL_STD, DeviceParameters, draw_device

LOT_SHARE = 0.6
"""Spread of the lots' means in spreads of the class."""
DEVICE_SHARE = 0.3
"""Spread within a lot in spreads of the class, in the median over coefficients."""
OUTLIER_SHARE = 0.03
"""Share of the devices that are outliers."""
OUTLIER_DEVIATIONS = 4.0
"""How far an outlier's coefficient stands from the mean of its lot [standard deviations]."""
OUTLIER_MAGNITUDE = 8.0
"""Magnitude of the effect an outlier has and the others lack, as `simulate --magnitude`."""
COMMON_EFFECTS = (
    ('thermal_lag', 'gyroscope', 0.4),
    ('bias_temperature_curvature', 'accelerometer', 0.3),
)
"""Effect, sensor and median magnitude of what many devices have: weak in a single one."""
RARE_EFFECT = ('thermal_hysteresis', 'magnetometer')
LOG_MAGNITUDE_STD = 0.3
"""Standard deviation of the logarithm of an effect's magnitude over devices."""
MOST_LOTS = 26


@dataclass(frozen=True)
class CommonEffect:
    """An effect that a share of a lot has."""

    name: str
    sensor: str
    magnitude: float
    """Median over the devices that have it."""
    prevalence: float
    seed: int
    """Of its shape, which the lot shares."""


@dataclass(frozen=True, eq=False)
class Lot:
    """Distribution of the slopes of one lot; coefficients run over sensors, then axes."""

    name: str
    mean: FloatArray
    """(9,) [SI unit/K]."""
    covariance: FloatArray
    """(9, 9); sensors are independent of each other."""
    effects: tuple[CommonEffect, ...]


@dataclass(frozen=True)
class CarriedEffect:
    """An effect in one device."""

    name: str
    sensor: str
    magnitude: float
    seed: int


@dataclass(frozen=True, eq=False)
class FleetDevice:
    """One device of the population, its effects, and why it is an outlier where it is one."""

    parameters: DeviceParameters
    lot: str
    effects: tuple[CarriedEffect, ...]
    outlier: str = ''
    """`<sensor> <axis>` of its outlying coefficient, or its rare effect; '': no outlier."""

    @property
    def slopes(self) -> FloatArray:
        """(9,) slopes of bias over temperature [SI unit/K]."""
        return np.concatenate([self.parameters.sensor(name).slope for name in SENSOR_FIELDS])


def draw_lots(count: int, seed: int) -> list[Lot]:
    """Return lots A, B, … of one type; UserError where the alphabet ends."""
    if not 1 <= count <= MOST_LOTS:
        raise UserError(f'--lots {count}: choose from 1 to {MOST_LOTS}')
    draw = np.random.default_rng((seed, 71))
    spread = np.repeat([TYPICAL_STD[name][1] for name in SENSOR_FIELDS], 3)
    type_mean = draw.normal(0.0, 1.0, 9) * spread
    return [_draw_lot(chr(ord('A') + k), type_mean, spread, (seed, 71, k)) for k in range(count)]


def _draw_lot(name: str, mean: FloatArray, spread: FloatArray, key: tuple[int, ...]) -> Lot:
    draw = np.random.default_rng(key)
    deviation = DEVICE_SHARE * spread * np.exp(draw.normal(0.0, 0.2, 9))
    correlation = np.zeros((9, 9))
    for first in (0, 3, 6):
        loads = draw.normal(0.0, 0.7, 3)
        shared = np.outer(loads, loads) + np.eye(3)
        size = np.sqrt(np.diag(shared))
        correlation[first : first + 3, first : first + 3] = shared / np.outer(size, size)
    return Lot(
        name=name,
        mean=mean + LOT_SHARE * draw.normal(0.0, 1.0, 9) * spread,
        covariance=correlation * np.outer(deviation, deviation),
        effects=tuple(
            CommonEffect(
                name=effect,
                sensor=sensor,
                magnitude=magnitude,
                prevalence=float(draw.choice([0.0, 0.3, 0.6, 0.85])),
                seed=int(draw.integers(2**31)),
            )
            for effect, sensor, magnitude in COMMON_EFFECTS
        ),
    )


def draw_fleet_device(lots: list[Lot], number: int, count: int, seed: int) -> FleetDevice:
    """Return device `number` of `count`; lots follow each other, as equal as they can be.

    It depends on the arguments alone: a fleet is drawn in any order, on any number of processes.

    >>> device = draw_fleet_device(draw_lots(4, seed=3), 199, 200, seed=3)
    >>> device.lot, device.parameters.name
    ('D', 'D00200')
    """
    lot = lots[number * len(lots) // count]
    draw = np.random.default_rng((seed, 73, number))
    slopes = draw.multivariate_normal(lot.mean, lot.covariance, method='cholesky')
    effects = [
        CarriedEffect(
            name=common.name,
            sensor=common.sensor,
            magnitude=common.magnitude * float(np.exp(LOG_MAGNITUDE_STD * size)),
            seed=common.seed,
        )
        for common, chance, size in zip(
            lot.effects, draw.random(len(lot.effects)), draw.normal(size=len(lot.effects)),
            strict=True,
        )
        if chance < common.prevalence
    ]  # fmt: skip
    outlier = ''
    kind = draw.random() / OUTLIER_SHARE
    if kind < 0.5:
        place = int(draw.integers(9))
        sign = float(draw.choice([-1.0, 1.0]))
        slopes[place] = (
            lot.mean[place] + sign * OUTLIER_DEVIATIONS * lot.covariance[place, place] ** 0.5
        )
        outlier = f'{list(SENSOR_FIELDS)[place // 3]} {"xyz"[place % 3]}'
    elif kind < 1.0:
        outlier, sensor = RARE_EFFECT
        effects.append(
            CarriedEffect(
                name=outlier,
                sensor=sensor,
                magnitude=OUTLIER_MAGNITUDE,
                seed=int(draw.integers(2**31)),
            )
        )
    name = f'{lot.name}{number + 1:05d}'
    return FleetDevice(
        parameters=_with_slopes((seed, number), name, slopes),
        lot=lot.name,
        effects=(*effects,),
        outlier=outlier,
    )


def _with_slopes(key: tuple[int, ...], name: str, slopes: FloatArray) -> DeviceParameters:
    device = draw_device(key)
    sensors: dict[str, Any] = {
        sensor: replace(device.sensor(sensor), slope=slopes[3 * k : 3 * k + 3])
        for k, sensor in enumerate(SENSOR_FIELDS)
    }
    return replace(device, name=name, **sensors)
