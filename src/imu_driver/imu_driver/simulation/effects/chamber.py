# SPDX-License-Identifier: Apache-2.0
"""Hidden effects of chamber and fixture: currents, iron, brackets, fixed in its frame."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray
from numpy.random import Generator

from imu_driver.simulation.effects.hidden_effect import (
    ErrorShape,
    Runs,
    along_axes,
    hidden_effect,
    in_sensor,
    log_uniform,
)
from imu_driver.simulation.environment import low_pass
from imu_driver.simulation.noise import ou_process
from imu_driver.simulation.pose import rotation_vector_matrix
from imu_driver.simulation.run import world_vector
from imu_driver.simulation.thermal import BOARD, DIE

CURIE_TEMPERATURE = 1043.0
"""Curie temperature of iron [K]."""


def _direction(generator: Generator) -> FloatArray:
    """Return (3,) a direction in the chamber, no component below a quarter.

    Components do not add up: over three cyclic poses their mean looks like the sensor's own.
    """
    while True:
        vector = generator.normal(0.0, 1.0, 3)
        unit: FloatArray = vector / np.linalg.norm(vector)
        if np.abs(unit).min() > 0.25 and abs(unit.sum()) < 0.6:
            return unit


@hidden_effect(('magnetometer',), logged_as=('heater',))
def heater_hard_iron(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """The loop of the heater's current; its resistance rises 3 % as the element warms."""
    direction = _direction(generator)
    errors = []
    for run in runs:
        duty = run.environment.column('heater')
        current = duty * (1.0 - 0.03 * low_pass(duty, 60.0, run.environment.period))
        errors.append(along_axes(current, run.matrix @ direction))
    return in_sensor(sensor, errors)


@hidden_effect(('magnetometer',), logged_as=('compressor',))
def compressor_hard_iron(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """The motor's stray field while it runs, with its load."""
    direction = _direction(generator)
    errors = []
    for run in runs:
        load = 1.0 + 0.02 * ou_process(
            len(run.environment.time), run.environment.period, 300.0, generator
        )
        errors.append(
            along_axes(run.environment.column('compressor') * load, run.matrix @ direction)
        )
    return in_sensor(sensor, errors)


@hidden_effect(('magnetometer',))
def fixture_hard_iron(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """Magnetised steel of the fixture loses remanence as it warms: Bloch's T^(3/2) law."""
    direction = _direction(generator)
    errors = []
    for run in runs:
        kelvin = run.nodes[:, BOARD] + 273.15
        remanence = 1.0 - (kelvin / CURIE_TEMPERATURE) ** 1.5
        errors.append(along_axes(remanence, run.matrix @ direction))
    return in_sensor(sensor, errors)


@hidden_effect(('accelerometer+magnetometer',))
def fixture_tilt(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """The bracket bends with its temperature and turns the device: finite rotation."""
    bend = 50e-6 * _direction(generator)
    errors = []
    for run in runs:
        bracket = run.nodes[:, BOARD] - run.nodes[:, BOARD].mean()
        levels = np.linspace(bracket.min() - 1.0, bracket.max() + 1.0, 13)
        error = {}
        for name in sensor.split('+'):
            world = world_vector(run.environment, name)
            turned = np.array(
                [run.matrix @ (rotation_vector_matrix(-bend * level) @ world) for level in levels]
            ) - run.true_input(name)
            error[name] = np.column_stack([np.interp(bracket, levels, t) for t in turned.T])
        errors.append(error)
    return ErrorShape(errors)


@hidden_effect(('magnetometer',))
def mains_alias(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """Mains current of the heater, sampled by a crystal clock close to a divisor of 50 Hz.

    The beat drifts with the crystal by some 10⁻⁸ per kelvin; the current's amplitude follows the
    heater only weakly, as fan and controls draw theirs all the time.
    """
    frequency = log_uniform(generator, 3e-3, 1.8e-2)
    direction = _direction(generator)
    errors = []
    for run in runs:
        period = run.environment.period
        beat = frequency + 50.0 * 4e-9 * (run.nodes[:, DIE] - 20.0)
        phase = 2.0 * np.pi * (generator.uniform() + np.cumsum(beat) * period)
        current = 1.0 + 0.15 * (low_pass(run.environment.column('heater'), 20.0, period) - 0.1)
        errors.append(along_axes(current * np.cos(phase), run.matrix @ direction))
    return in_sensor(sensor, errors, frequency=frequency)
