# SPDX-License-Identifier: Apache-2.0
"""Hidden effects of time, power, moisture and vibration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray
from imu_recording.user_error import UserError

from imu_driver.simulation.effects.effect import (
    Law,
    Shape,
    along_axes,
    axis_gains,
    in_sensor,
    log_uniform,
)
from imu_driver.simulation.environment import low_pass
from imu_driver.simulation.run import DeviceRun
from imu_driver.simulation.thermal import BOARD

ALL = ('accelerometer', 'gyroscope', 'magnetometer')
MOVING = ('accelerometer', 'gyroscope')
"""Sensors with a moving mass."""


@njit(cache=True)
def discharge(time: FloatArray, time_constant: float) -> FloatArray:
    """Return (n,) a trapped charge that leaks away after power-on, 1 at the start.

    dq/dt = −q·(1 + 0.04 q)/τ: a little faster while there is much of it.
    """
    charge = np.empty(len(time))
    q = 1.0
    for k in range(len(time)):
        charge[k] = q
        if k + 1 < len(time):
            step = time[k + 1] - time[k]
            q -= q * (1.0 + 0.04 * q) / time_constant * step
    return charge


def warm_up(runs: Sequence[DeviceRun], sensor: str, generator: np.random.Generator) -> Shape:
    """Charge trapped in the oxide leaks away after each power-on, the same way every time."""
    time = log_uniform(generator, 200.0, 1500.0)
    gains = axis_gains(generator)
    return in_sensor(
        sensor,
        [along_axes(discharge(run.environment.time, time), gains) for run in runs],
        time_constant=time / 1.025,
    )


def supply(runs: Sequence[DeviceRun], sensor: str, generator: np.random.Generator) -> Shape:
    """The output divides by the supply, not by the reference: ratiometric, 1/V."""
    gains = axis_gains(generator)
    waves = [along_axes(run.device.supply_voltage / run.supply - 1.0, gains) for run in runs]
    return in_sensor(sensor, waves)


def rectification(runs: Sequence[DeviceRun], sensor: str, generator: np.random.Generator) -> Shape:
    """The mean of a slightly bent characteristic over a sinusoidal vibration.

    K₂·⟨a²⟩ + K₄·⟨a⁴⟩ with ⟨a⁴⟩ = 1.5·⟨a²⟩² of a sine; a gyroscope feels the whole vibration.
    """
    gains = axis_gains(generator)
    waves = []
    for run in runs:
        felt = run.vibration
        if sensor == 'gyroscope':
            felt = np.repeat(felt.sum(axis=1, keepdims=True), 3, axis=1)
        typical = float(felt.mean()) or 1.0
        waves.append((felt + 0.02 * 1.5 * felt**2 / typical) * gains)
    return in_sensor(sensor, waves)


def humidity(runs: Sequence[DeviceRun], sensor: str, generator: np.random.Generator) -> Shape:
    """Moisture soaks into the mould, two layers one behind the other, and swells it."""
    time = log_uniform(generator, 1200.0, 6000.0)
    gains = axis_gains(generator)
    waves = []
    for run in runs:
        if run.environment.humidity is None:
            raise UserError('humidity cannot act: the environment has none')
        period = run.environment.period
        outer = low_pass(run.environment.humidity, time, period)
        inner = low_pass(outer, 0.04 * time, period)
        waves.append(along_axes(0.8 * outer + 0.2 * inner, gains))
    return in_sensor(sensor, waves, time_constant=time)


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


def icing(runs: Sequence[DeviceRun], sensor: str, generator: np.random.Generator) -> Shape:
    """Frost grows on the board while it is below 0 °C and presses on the package."""
    growth = log_uniform(generator, 600.0, 3000.0)
    melt = log_uniform(generator, 200.0, 900.0)
    gains = axis_gains(generator)
    waves = [
        along_axes(
            ice_mass(run.nodes[:, BOARD].copy(), growth, melt, run.environment.period), gains
        )
        for run in runs
    ]
    return in_sensor(sensor, waves, growth_time=growth, melt_time=melt)


def turn_on(runs: Sequence[DeviceRun], sensor: str, generator: np.random.Generator) -> Shape:
    """Power is cycled at the start of every thermal cycle; each power-on has a bias of its own."""
    waves = []
    for run in runs:
        if run.environment.cycle is None or run.environment.cycle.max() < 2:
            raise UserError('turn_on_bias needs a profile with at least two cycles')
        number = np.maximum.accumulate(run.environment.cycle)
        levels = generator.normal(0.0, 1.0, (int(number.max()) + 1, 3))
        levels[0] = levels[1]
        waves.append(levels[number])
    return in_sensor(sensor, waves)


def step(runs: Sequence[DeviceRun], sensor: str, generator: np.random.Generator) -> Shape:
    """Solder slips once, in one run, within seconds."""
    which = int(generator.integers(len(runs)))
    time = runs[which].environment.time
    at = float(time[-1] * generator.uniform(0.2, 0.8))
    gains = axis_gains(generator)
    slip = 1.0 / (1.0 + np.exp(-np.clip((time - at) / 3.0, -50.0, 50.0)))
    waves = [
        along_axes(slip if k == which else np.zeros(len(run.environment.time)), gains)
        for k, run in enumerate(runs)
    ]
    return in_sensor(sensor, waves, step_time=at, run=float(which))


def drift(runs: Sequence[DeviceRun], sensor: str, generator: np.random.Generator) -> Shape:
    """The package relaxes with a time constant of 200 h: within a run nearly a line."""
    gains = axis_gains(generator)
    waves = [along_axes(-np.expm1(-run.environment.time / 7.2e5), gains) for run in runs]
    return in_sensor(sensor, waves)


def creep(runs: Sequence[DeviceRun], sensor: str, generator: np.random.Generator) -> Shape:
    """Adhesive creeps: relaxation times spread evenly in logarithm, to months, few below t₀.

    ln(1 + t/t₀) = ∫ (1 − e^(−t/τ)) e^(−t₀/τ) d ln τ; 33 processes are within 0.4 % of it.
    """
    start = 0.5 * log_uniform(generator, 300.0, 1500.0)
    times = start * np.geomspace(0.1, 2e4, 33)
    gains = axis_gains(generator)
    waves = []
    for run in runs:
        crept = np.zeros(len(run.environment.time))
        for time in times:
            crept -= np.exp(-start / time) * np.expm1(-run.environment.time / time)
        waves.append(along_axes(crept, gains))
    return in_sensor(sensor, waves, time_constant=start)


def random_walk(runs: Sequence[DeviceRun], sensor: str, generator: np.random.Generator) -> Shape:
    """Bias that walks at random, differently in every run and axis."""
    waves = [
        np.cumsum(generator.standard_normal((len(run.environment.time), 3)), axis=0)
        for run in runs
    ]
    return in_sensor(sensor, waves)


LAWS = (
    Law('warm_up', ALL, warm_up),
    Law('supply_sensitivity', ALL, supply),
    Law('vibration_rectification', MOVING, rectification),
    Law('humidity', MOVING, humidity),
    Law('icing', MOVING, icing),
    Law('turn_on_bias', ALL, turn_on),
    Law('bias_step', ALL, step),
    Law('bias_drift', ALL, drift),
    Law('bias_creep', ALL, creep),
    Law('random_walk', ALL, random_walk),
)
