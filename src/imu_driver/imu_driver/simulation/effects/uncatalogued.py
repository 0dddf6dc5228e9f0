# SPDX-License-Identifier: Apache-2.0
"""Hidden effects outside the catalogue: a diagnosis has to call them unexplained."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from imu_driver.simulation.effects.hidden_effect import (
    ALL_SENSORS,
    ErrorShape,
    Runs,
    along_axes,
    axis_gains,
    hidden_effect,
    in_sensor,
)
from imu_driver.simulation.thermal import DIE


@hidden_effect(ALL_SENSORS, kind='unexplained', depends_on=('temperature',))
def mode_crossing(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """A parasitic mode crosses the drive frequency at one temperature (IEEE 528 activity dip)."""
    centre = float(generator.choice([generator.uniform(-3, 12), generator.uniform(26, 43)]))
    width = float(generator.uniform(1.5, 3.0))
    gains = axis_gains(generator)
    return in_sensor(
        sensor,
        [
            along_axes(1.0 / (1.0 + ((run.nodes[:, DIE] - centre) / width) ** 2), gains)
            for run in runs
        ],
        centre=centre,
        width=width,
    )


@hidden_effect(ALL_SENSORS, kind='unexplained', depends_on=('temperature', 'time'))
def ageing_slope(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """The temperature coefficient itself ages: temperature times time."""
    gains = axis_gains(generator)
    errors = [
        along_axes(run.temperature_difference * run.environment.time / 43200.0, gains)
        for run in runs
    ]
    return in_sensor(sensor, errors)


@hidden_effect(ALL_SENSORS, kind='unexplained', depends_on=('temperature',))
def resonance_comb(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """Standing waves in the package beat with the drive: a comb over temperature."""
    pitch = float(generator.uniform(9.0, 14.0))
    shift = generator.uniform(0.0, 2 * np.pi)
    gains = axis_gains(generator)
    return in_sensor(
        sensor,
        [along_axes(np.cos(2 * np.pi * run.nodes[:, DIE] / pitch + shift), gains) for run in runs],
        pitch=pitch,
    )


@hidden_effect(ALL_SENSORS, kind='unexplained', depends_on=('time',))
def room_rhythm(runs: Runs, sensor: str, generator: Generator) -> ErrorShape:
    """The building's ventilation swings every few hours and reaches the read-out's reference."""
    period = float(generator.uniform(3.0, 4.2)) * 3600.0
    shift = generator.uniform(0.0, 2 * np.pi)
    gains = axis_gains(generator)
    return in_sensor(
        sensor,
        [
            along_axes(np.sin(2 * np.pi * run.environment.time / period + shift), gains)
            for run in runs
        ],
        period=period,
    )
