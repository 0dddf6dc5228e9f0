# SPDX-License-Identifier: Apache-2.0
"""Hidden effects of time: warm-up, turn-on, steps, drift, creep, random walk of the bias."""

from __future__ import annotations

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray
from imu_recording.user_error import UserError
from numpy.random import Generator

from imu_driver.simulation.effects.hidden_effect import (
    ALL_SENSORS,
    ErrorShape,
    Runs,
    along_axes,
    axis_gains,
    hidden_effect,
    in_sensor,
    log_uniform,
)


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


@hidden_effect(ALL_SENSORS)
def warm_up(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """Charge trapped in the oxide leaks away after each power-on, the same way every time."""
    time = log_uniform(generator, 200.0, 1500.0)
    gains = axis_gains(generator)
    return in_sensor(
        sensor,
        [along_axes(discharge(run.environment.time, time), gains) for run in runs],
        time_constant=time / 1.025,
    )


@hidden_effect(ALL_SENSORS)
def turn_on_bias(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """Power is cycled at the start of every thermal cycle; each power-on has a bias of its own."""
    errors = []
    for run in runs:
        if run.environment.cycle is None or run.environment.cycle.max() < 2:
            raise UserError('turn_on_bias needs a profile with at least two cycles')
        number = np.maximum.accumulate(run.environment.cycle)
        levels = generator.normal(0.0, 1.0, (int(number.max()) + 1, 3))
        levels[0] = levels[1]
        errors.append(levels[number])
    return in_sensor(sensor, errors)


@hidden_effect(ALL_SENSORS)
def bias_step(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """Solder slips once, in one run, within seconds."""
    which = int(generator.integers(len(runs)))
    time = runs[which].environment.time
    at = float(time[-1] * generator.uniform(0.2, 0.8))
    gains = axis_gains(generator)
    slip = 1.0 / (1.0 + np.exp(-np.clip((time - at) / 3.0, -50.0, 50.0)))
    errors = [
        along_axes(slip if k == which else np.zeros(len(run.environment.time)), gains)
        for k, run in enumerate(runs)
    ]
    return in_sensor(sensor, errors, step_time=at, run=float(which))


@hidden_effect(ALL_SENSORS)
def bias_drift(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """The package relaxes with a time constant of 200 h: within a run nearly a line."""
    gains = axis_gains(generator)
    errors = [along_axes(-np.expm1(-run.environment.time / 7.2e5), gains) for run in runs]
    return in_sensor(sensor, errors)


@hidden_effect(ALL_SENSORS)
def bias_creep(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """Adhesive creeps: relaxation times spread evenly in logarithm, to months, few below t₀.

    ln(1 + t/t₀) = ∫ (1 − e^(−t/τ)) e^(−t₀/τ) d ln τ; 33 processes are within 0.4 % of it.
    """
    start = 0.5 * log_uniform(generator, 300.0, 1500.0)
    times = start * np.geomspace(0.1, 2e4, 33)
    gains = axis_gains(generator)
    errors = []
    for run in runs:
        crept = np.zeros(len(run.environment.time))
        for time in times:
            crept -= np.exp(-start / time) * np.expm1(-run.environment.time / time)
        errors.append(along_axes(crept, gains))
    return in_sensor(sensor, errors, time_constant=start)


@hidden_effect(ALL_SENSORS, kind='noise')
def random_walk(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """Bias that walks at random, differently in every run and axis."""
    errors = [
        np.cumsum(generator.standard_normal((len(run.environment.time), 3)), axis=0)
        for run in runs
    ]
    return in_sensor(sensor, errors)
