# SPDX-License-Identifier: Apache-2.0
"""Hidden effects of heat in the device: material laws, extra nodes, plasticity, shelter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray
from numpy.random import Generator

from imu_driver.simulation.devices import REFERENCE_TEMPERATURE
from imu_driver.simulation.effects.hidden_effect import (
    ALL_SENSORS,
    EXCITED_AT_REST,
    ErrorShape,
    Runs,
    along_axes,
    axis_gains,
    hidden_effect,
    in_sensor,
    log_uniform,
)
from imu_driver.simulation.environment import low_pass
from imu_driver.simulation.run import DeviceRun, thermal_load
from imu_driver.simulation.thermal import BOARD, DIE, convection, node_temperatures


@hidden_effect(ALL_SENSORS)
def bias_temperature_curvature(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """The die's expansion and modulus change with temperature: the bias bends."""
    bend = generator.choice([-1.0, 1.0], 3) * generator.uniform(3e-3, 8e-3, 3)
    return in_sensor(
        sensor,
        [
            np.column_stack(
                [
                    thermal_load(run.nodes, sensor, float(b))
                    - thermal_load(run.nodes, sensor, 0.0)
                    for b in bend
                ]
            )
            for run in runs
        ],
        bend_x=float(bend[0]),
        bend_y=float(bend[1]),
        bend_z=float(bend[2]),
    )


def softening(temperature: FloatArray) -> FloatArray:
    """Return (n,) the relative change of stiffness times −10⁶ at a temperature [°C].

    Wachtman's law E = E₀ − B·T·exp(−T₀/T) [K] for silicon, B/E₀ = 6.6e-5/K, T₀ = 317 K.
    """
    kelvin = temperature + 273.15
    reference = REFERENCE_TEMPERATURE + 273.15
    change: FloatArray = 66.0 * (
        kelvin * np.exp(-317.0 / kelvin) - reference * np.exp(-317.0 / reference)
    )
    return change


@hidden_effect(EXCITED_AT_REST)
def scale_factor_temperature(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """The springs soften, the bridge loses gain: the true input is read too large or small."""
    gains = generator.uniform(0.7, 1.3, 3) * generator.choice([-1.0, 1.0])
    return in_sensor(
        sensor,
        [
            along_axes(1e-6 * softening(run.nodes[:, DIE]), gains * run.true_input(sensor))
            for run in runs
        ],
    )


@hidden_effect(EXCITED_AT_REST)
def misalignment_temperature(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """The die turns and shears on its glue: finite rotation by the thermal load, plus shear.

    The two off-diagonal terms of a row have opposite signs: equal ones could not be told from a
    scale factor with three orientations.
    """
    turn = axis_gains(generator) * 40e-6
    shear = generator.normal(0.0, 10e-6, 3)
    errors = []
    for run in runs:
        load = thermal_load(run.nodes, sensor, 5e-4)
        seen = run.true_input(sensor)
        errors.append(_turned(load, turn, seen) + along_axes(load, _symmetric(shear) @ seen))
    return in_sensor(sensor, errors)


def _symmetric(shear: FloatArray) -> FloatArray:
    xy, xz, yz = shear
    return np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])


def _turned(load: FloatArray, turn: FloatArray, seen: FloatArray) -> FloatArray:
    """Return (n, 3) the change of a vector that is turned by load·turn, finite angle."""
    size = float(np.linalg.norm(turn))
    axis = turn / size
    angle = load * size
    across = np.cross(axis, seen)
    change: FloatArray = along_axes(np.sin(angle), across) + along_axes(
        1.0 - np.cos(angle), np.cross(axis, across)
    )
    return change


@hidden_effect(('gyroscope',))
def g_sensitivity_temperature(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """The tuning forks' mass imbalance shifts as the frame around them is strained by heat."""
    pattern = generator.normal(0.0, 1.0, (3, 3))
    # Equal columns per row could not be told from a bias with three orientations.
    pattern -= 0.8 * pattern.mean(axis=1, keepdims=True)
    errors = []
    for run in runs:
        load = thermal_load(run.nodes, sensor, 5e-4)
        errors.append(along_axes(load, pattern @ run.true_input('accelerometer')))
    return in_sensor(sensor, errors)


LEAK_SHARE = 0.01
"""Share of a node's heat that bypasses the node before it."""


@njit(cache=True)
def follow(
    drive: FloatArray, leak: FloatArray, time: float, share: float, period: float
) -> FloatArray:
    """Return (n,) a node that follows `drive`, and by a small `share` `leak`.

    Its conductance grows by 0.05 % per kelvin, as that of filled epoxy.
    """
    node = np.empty(len(drive))
    value = (drive[0] + share * leak[0]) / (1.0 + share)
    node[0] = value
    for k in range(1, len(drive)):
        conductance = 1.0 + 5e-4 * (value - REFERENCE_TEMPERATURE)
        pull = period / time * conductance
        value = (value + pull * (drive[k] + share * leak[k])) / (1.0 + pull * (1.0 + share))
        node[k] = value
    return node


@hidden_effect(ALL_SENSORS)
def thermal_lag(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """The stressed glue under the element warms later than the thermometer."""
    time = log_uniform(generator, 60.0, 400.0) / runs[0].device.glue_conductance
    gains = axis_gains(generator)
    errors = []
    for run in runs:
        die = run.nodes[:, DIE].copy()
        node = follow(die, run.nodes[:, BOARD].copy(), time, LEAK_SHARE, run.environment.period)
        errors.append(along_axes(node - die, gains))
    return in_sensor(sensor, errors, time_constant=time / (1.0 + LEAK_SHARE))


@hidden_effect(ALL_SENSORS)
def thermal_lag_two_stage(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """Two nodes in a row: glue, then a heavy part of the board."""
    fast = log_uniform(generator, 40.0, 100.0) / runs[0].device.glue_conductance
    slow = log_uniform(generator, 800.0, 1500.0)
    fast_gains, slow_gains = axis_gains(generator), 0.5 * axis_gains(generator)
    errors = []
    for run in runs:
        die, period = run.nodes[:, DIE].copy(), run.environment.period
        glue = follow(die, run.nodes[:, BOARD].copy(), fast, LEAK_SHARE, period)
        heavy = follow(glue, run.environment.air_temperature, slow, LEAK_SHARE, period)
        errors.append(along_axes(glue - die, fast_gains) + along_axes(heavy - die, slow_gains))
    slow /= 1.0 + LEAK_SHARE
    return in_sensor(sensor, errors, time_constant_fast=fast, time_constant_slow=slow)


@hidden_effect(ALL_SENSORS)
def temperature_rate(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """Heat that flows through the die bends it while it flows: as fast as the die itself.

    Taken from the difference between the die and a layer 4 s behind it.
    """
    gains = axis_gains(generator)
    errors = []
    for run in runs:
        die = run.nodes[:, DIE].copy()
        layer = follow(die, die, 4.0, 0.0, run.environment.period)
        errors.append(along_axes((die - layer) / 4.0, gains))
    return in_sensor(sensor, errors)


FACE_TIME_CONSTANT = 6.0
"""Time constant of the package's face in the free stream [s]."""
FACE_LEAK_SHARE = 0.05
"""Heat the face takes from the board, as a share of what it takes from the stream."""
FIXTURE_AIR_SHARE = 0.25
"""Share of the air at the device that has passed the fixture first."""
FIXTURE_TIME_CONSTANT = 1200.0
"""Time constant of the fixture: 2 kg of aluminium in moved air [s]."""


def sheltered(run: DeviceRun) -> DeviceRun:
    """Return the run with the device in the lee of a heavy fixture, or unchanged if it is there.

    The free stream, which the chamber's thermometers measure and one face of the package feels,
    and the air that warms the board part: their difference lasts through dwells with the time
    constant of the fixture and is not proportional to the rate of the die's temperature.
    """
    environment = run.environment
    if environment.free_stream is not None:
        return run
    free, period = environment.air_temperature, environment.period
    fixture = low_pass(free, FIXTURE_TIME_CONSTANT, period)
    lee = replace(
        environment,
        air_temperature=free + FIXTURE_AIR_SHARE * (fixture - free),
        free_stream=free,
    )
    nodes = node_temperatures(run.device.network, lee.air_temperature, period)
    errors = {sensor: values + _moved(run, nodes, sensor) for sensor, values in run.errors.items()}
    return replace(run, environment=lee, nodes=nodes, errors=errors)


def _moved(run: DeviceRun, nodes: FloatArray, sensor: str) -> FloatArray:
    """Return (n, 3) the change of the thermal bias from the run's own nodes to others."""
    parameters = run.device.sensor(sensor)
    load = thermal_load(nodes, sensor, parameters.stiffening) - thermal_load(
        run.nodes, sensor, parameters.stiffening
    )
    moved: FloatArray = np.multiply.outer(load, parameters.slope)
    return moved


@hidden_effect(ALL_SENSORS, mounting=sheltered)
def thermal_gradient(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """A face of the package in the free stream, the rest in the lee: heat flows across it.

    The face follows the stream within seconds and takes a little heat from the board.
    """
    gains = axis_gains(generator)
    errors = []
    for run in runs:
        board = run.nodes[:, BOARD].copy()
        free = run.environment.free_stream
        stream = run.environment.air_temperature if free is None else free
        face = follow(
            stream.copy(), board, FACE_TIME_CONSTANT, FACE_LEAK_SHARE, run.environment.period
        )
        difference = face - run.nodes[:, DIE]
        flux = np.array([convection(run.device.network, d) * d for d in difference])
        errors.append(along_axes(flux / run.device.network.air_to_board, gains))
    return in_sensor(sensor, errors)


@njit(cache=True)
def bouc_wen(temperature: FloatArray, width: float, sharpness: float) -> FloatArray:
    """Return (n,) the plastic part of a load that follows temperature, rate independent.

    dz = (1 − |z/w|ⁿ·(0.55 + 0.45·sign(z·dT)))·dT (Bouc 1967, Wen 1976); z [K], w = `width`.
    """
    z = 0.0
    plastic = np.zeros(len(temperature))
    for k in range(1, len(temperature)):
        total = temperature[k] - temperature[k - 1]
        steps = int(abs(total) / 0.05) + 1
        for _ in range(steps):
            step = total / steps
            way = 1.0 if z * step > 0.0 else -1.0
            z += (1.0 - abs(z / width) ** sharpness * (0.55 + 0.45 * way)) * step
        plastic[k] = z
    return plastic


@hidden_effect(ALL_SENSORS)
def thermal_hysteresis(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """Glue and solder yield: a smooth elasto-plastic element (Bouc–Wen) over the die."""
    width = log_uniform(generator, 6.0, 16.0)
    sharpness = float(generator.uniform(1.0, 1.8))
    gains = axis_gains(generator)
    errors = [
        along_axes(bouc_wen(run.nodes[:, DIE].copy(), width, sharpness), gains) for run in runs
    ]
    return in_sensor(sensor, errors, width=width, sharpness=sharpness)
