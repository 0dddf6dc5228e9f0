# SPDX-License-Identifier: Apache-2.0
"""One run of a simulated device before it is read out: node temperatures and slow errors."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import SENSOR_FIELDS, FloatArray
from imu_recording.user_error import UserError

from imu_driver.simulation.devices import (
    REFERENCE_TEMPERATURE,
    DeviceParameters,
    SensorParameters,
    find_device,
)
from imu_driver.simulation.environment import Environment, supply_voltage, vibration_variance
from imu_driver.simulation.noise import flicker_noise
from imu_driver.simulation.pose import Motion, pose_matrix, rotation_vector_matrix
from imu_driver.simulation.thermal import DIE, MAGNETOMETER, node_temperatures

PLACEMENT_STD = 3e-3
"""Placement error of a device in the fixture, each axis [rad]."""


@dataclass(frozen=True, eq=False)
class DeviceRun:
    """A device in its environment; every array has one row per row of the environment."""

    device: DeviceParameters
    environment: Environment
    orientation: str
    """Sensor axis that points up, '+x' … '-z'."""
    placement: FloatArray
    """(3, 3) small rotation of the device in its fixture."""
    nodes: FloatArray
    """(n, 4) temperatures of board, package, die, magnetometer die [°C]."""
    supply: FloatArray
    """(n,) [V]."""
    vibration: FloatArray
    """(n, 3) variance of the vibration [(m/s²)²]."""
    errors: dict[str, FloatArray]
    """Sensor → (n, 3) slow error [SI unit]; white noise and input errors come with reading out."""
    motion: Motion | None = None
    seed: tuple[int, ...] = ()
    rate_slope: float | None = None
    """Replaces the device's own where given [1/K]."""
    hidden: dict[str, FloatArray] = field(default_factory=dict)
    """Sensor → (n, 3) share of the errors that was hidden on purpose."""

    @property
    def matrix(self) -> FloatArray:
        """(3, 3) world → sensor frame of the resting device, placement included."""
        turned: FloatArray = self.placement @ pose_matrix(self.orientation)
        return turned

    @property
    def temperature_difference(self) -> FloatArray:
        """(n,) temperature of the die minus the reference temperature [K]."""
        above: FloatArray = self.nodes[:, DIE] - REFERENCE_TEMPERATURE
        return above

    def true_input(self, sensor: str) -> FloatArray:
        """Return (3,) the true input of the resting sensor, sensor frame [SI unit]."""
        world = world_vector(self.environment, sensor)
        seen: FloatArray = self.matrix @ world
        return seen


def world_vector(environment: Environment, sensor: str) -> FloatArray:
    """Return (3,) the true input of a resting sensor in the world frame (ENU) [SI unit]."""
    return {
        'accelerometer': np.array([0.0, 0.0, environment.gravity]),
        'gyroscope': environment.earth_rate,
        'magnetometer': environment.magnetic_field,
    }[sensor]


@njit(cache=True)
def stress_strain(difference: float, stiffening: float) -> Any:
    """Return the thermo-elastic load of a die on its package, in kelvin of linear law.

    Expansion grows as exp(s·x) while the modulus of the adhesive falls as 1/(1 + 0.3·s·x)
    (Timoshenko's bimetal with temperature-dependent layers); slope 1 at x = 0.
    """
    x = stiffening * difference
    if abs(x) < 1e-9:
        return difference
    return difference * (np.expm1(x) / x) / (1.0 + 0.3 * x)


@njit(cache=True)
def bandgap_current(difference: float, curvature: float) -> Any:
    """Return the offset of a bandgap-biased bridge, in kelvin of linear law.

    A bandgap reference leaves a residue T·ln(T/T0) (Widlar); `curvature` [1/K] is the relative
    change of slope per kelvin, slope 1 at x = 0.
    """
    kelvin = REFERENCE_TEMPERATURE + 273.15
    absolute = kelvin + difference
    residue = absolute * np.log(absolute / kelvin) - difference
    return difference + curvature * kelvin * residue


@njit(cache=True)
def _loads(temperature: FloatArray, bend: float, magnetic: bool) -> FloatArray:
    load = np.empty(len(temperature))
    for k in range(len(temperature)):
        x = temperature[k] - REFERENCE_TEMPERATURE
        load[k] = bandgap_current(x, bend) if magnetic else stress_strain(x, bend)
    return load


def thermal_load(run_nodes: FloatArray, sensor: str, bend: float) -> FloatArray:
    """Return (n,) by how many kelvin of linear law the sensor's bias has moved."""
    magnetic = sensor == 'magnetometer'
    node = np.ascontiguousarray(run_nodes[:, MAGNETOMETER if magnetic else DIE])
    load: FloatArray = _loads(node, bend, magnetic)
    return load


def prepare_run(
    device: str | DeviceParameters,
    environment: Environment,
    *,
    seed: int | tuple[int, ...],
    orientation: str = '+z',
    motion: Motion | None = None,
    field_jumps: bool = False,
) -> DeviceRun:
    """Return the run of a device: heat, supply, vibration and every slow error."""
    parameters = find_device(device)
    key = (seed,) if isinstance(seed, int) else tuple(seed)
    nodes = node_temperatures(parameters.network, environment.air_temperature, environment.period)
    placed = np.random.default_rng((*key, 1))
    placement = rotation_vector_matrix(placed.normal(0.0, PLACEMENT_STD, 3))
    supply = supply_voltage(environment, parameters.supply_voltage, placed)
    vibration = vibration_variance(environment, placed)
    errors = {}
    for number, sensor in enumerate(SENSOR_FIELDS):
        errors[sensor] = _slow_error(
            parameters.sensor(sensor),
            thermal_load(nodes, sensor, parameters.sensor(sensor).stiffening),
            supply - parameters.supply_voltage,
            environment.period,
            np.random.default_rng((*key, 2, number)),
        )
    if field_jumps:
        errors['magnetometer'] += _field_jumps(parameters, environment)
    return DeviceRun(
        device=parameters,
        environment=environment,
        orientation=orientation,
        placement=placement,
        nodes=nodes,
        supply=supply,
        vibration=vibration,
        errors=errors,
        motion=motion,
        seed=key,
    )


def _slow_error(
    sensor: SensorParameters,
    load: FloatArray,
    supply: FloatArray,
    period: float,
    generator: np.random.Generator,
) -> FloatArray:
    turn_on = generator.normal(0.0, 1.0, 3) * sensor.turn_on_std
    error: FloatArray = flicker_noise(
        len(load), period, np.full(3, sensor.bias_instability), generator
    )
    error += sensor.bias + turn_on
    error += np.multiply.outer(load, sensor.slope)
    error += sensor.supply_slope * supply[:, None]
    return error


def _field_jumps(parameters: DeviceParameters, environment: Environment) -> FloatArray:
    """Return (n, 3) the level changes R1 … R4 of the paper's tables, at the cycles' starts [T]."""
    if environment.cycle is None:
        raise UserError('field jumps need a profile with cycles')
    row = np.clip(environment.cycle - 1, 0, len(parameters.field_levels) - 1)
    # Before the first cycle the level is R1's, after the last it stays.
    final = np.maximum.accumulate(np.where(environment.cycle > 0, row, 0))
    jumps: FloatArray = parameters.field_levels[final]
    return jumps
