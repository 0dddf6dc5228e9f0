# SPDX-License-Identifier: Apache-2.0
"""Hidden effects of exposure: supply, vibration, moisture, ice."""

from __future__ import annotations

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray
from imu_recording.user_error import UserError
from numpy.random import Generator

from imu_driver.simulation.effects.hidden_effect import (
    ALL_SENSORS,
    PROOF_MASS,
    ErrorShape,
    Runs,
    along_axes,
    axis_gains,
    hidden_effect,
    in_sensor,
    log_uniform,
)
from imu_driver.simulation.environment import low_pass
from imu_driver.simulation.thermal import BOARD


@hidden_effect(ALL_SENSORS, logged_as=('supply_voltage',))
def supply_sensitivity(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """The output divides by the supply, not by the reference: ratiometric, 1/V."""
    gains = axis_gains(generator)
    errors = [along_axes(run.device.supply_voltage / run.supply - 1.0, gains) for run in runs]
    return in_sensor(sensor, errors)


@hidden_effect(PROOF_MASS, logged_as=('vibration', 'compressor'))
def vibration_rectification(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """The mean of a slightly bent characteristic over a sinusoidal vibration.

    K₂·⟨a²⟩ + K₄·⟨a⁴⟩ with ⟨a⁴⟩ = 1.5·⟨a²⟩² of a sine; a gyroscope feels the whole vibration.
    """
    gains = axis_gains(generator)
    errors = []
    for run in runs:
        felt = run.vibration
        if sensor == 'gyroscope':
            felt = np.repeat(felt.sum(axis=1, keepdims=True), 3, axis=1)
        typical = float(felt.mean()) or 1.0
        errors.append((felt + 0.02 * 1.5 * felt**2 / typical) * gains)
    return in_sensor(sensor, errors)


@hidden_effect(PROOF_MASS, logged_as=('humidity',))
def humidity(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """Moisture soaks into the mould, two layers one behind the other, and swells it."""
    time = log_uniform(generator, 1200.0, 6000.0)
    gains = axis_gains(generator)
    errors = []
    for run in runs:
        if run.environment.humidity is None:
            raise UserError('humidity cannot act: the environment has none')
        period = run.environment.period
        outer = low_pass(run.environment.humidity, time, period)
        inner = low_pass(outer, 0.04 * time, period)
        errors.append(along_axes(0.8 * outer + 0.2 * inner, gains))
    return in_sensor(sensor, errors, time_constant=time)


@njit(cache=True)
def ice_mass(surface: FloatArray, growth: float, melt: float, period: float) -> FloatArray:
    """Return (n,) ice on the board, 0 … 1: freezes below 0 °C, melts above, both ramping in.

    Growth saturates as the air dries; both need some 0.2 K beyond 0 °C to run at full pace.
    """
    ice = np.zeros(len(surface))
    mass = 0.0
    for k in range(1, len(surface)):
        drive = np.tanh(surface[k] / 0.2)
        if drive < 0.0:
            mass += -drive * (1.0 - mass) * period / growth
        else:
            mass -= drive * mass * period / melt
        ice[k] = mass
    return ice


@hidden_effect(PROOF_MASS)
def icing(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """Frost grows on the board while it is below 0 °C and presses on the package."""
    growth = log_uniform(generator, 600.0, 3000.0)
    melt = log_uniform(generator, 200.0, 900.0)
    gains = axis_gains(generator)
    errors = [
        along_axes(
            ice_mass(run.nodes[:, BOARD].copy(), growth, melt, run.environment.period), gains
        )
        for run in runs
    ]
    return in_sensor(sensor, errors, growth_time=growth, melt_time=melt)
