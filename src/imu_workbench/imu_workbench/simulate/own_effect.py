# SPDX-License-Identifier: Apache-2.0
"""A user's own effect, written for thermal_comp, hidden in a simulated device.

The catalogue's effects are simulated by physics of the device's own, so that finding one proves
something. A user's effect has no second form: what is hidden is its own equation, at a shape
drawn within its bounds, and finding it proves that search, fit and compensation handle it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from imu_driver.simulation.effects.hidden_effect import ErrorShape, HiddenEffect, in_sensor
from imu_driver.simulation.hidden import HIDEABLE
from imu_driver.simulation.run import DeviceRun
from imu_driver.simulation.thermal import DIE
from thermal_comp.data.conditions import CHANNELS, SENSORS, Conditions
from thermal_comp.effects.effect import COUNT_UNIT, Effect
from thermal_comp.effects.user_effects import effect_catalogue

DISTANCE_FROM_BOUNDS = 0.1
"""Shapes are drawn this share of the range away from its ends, where runs show half an effect."""


def own_effects(files: Sequence[Path]) -> Mapping[str, HiddenEffect]:
    """Return the effects of the files as the simulator hides them, by name."""
    if not files:
        return {}
    return {
        name: HiddenEffect(name, tuple(effect.sensors), partial(_error_shape, effect))
        for name, effect in effect_catalogue(files).items()
        if name not in HIDEABLE
    }


def _error_shape(
    effect: type[Effect],
    runs: Sequence[DeviceRun],
    sensor: str,
    generator: np.random.Generator,
) -> ErrorShape:
    """Return the error of every run by the effect's own equation, coefficients ±1."""
    drawn = _drawn(effect, generator)
    columns = [drawn.columns(_conditions(run, sensor))[0] for run in runs]
    signs = generator.choice([-1.0, 1.0], (columns[0].shape[-1], 3))
    if columns[0].ndim == 3:  # coefficients that the axes share
        signs = signs[:, 0]
    return in_sensor(sensor, [each @ signs for each in columns], **_numbers(drawn))


def _drawn(effect: type[Effect], generator: np.random.Generator) -> Effect:
    """Return the effect at a shape within its bounds."""
    shape = {}
    for item in fields(effect):
        if item.metadata['unit'] == COUNT_UNIT or isinstance(item.default, tuple):
            continue
        low, high = item.metadata['bounds']
        share = generator.uniform(DISTANCE_FROM_BOUNDS, 1.0 - DISTANCE_FROM_BOUNDS)
        even = low <= 0.0 or high < 10.0 * low
        value = low + share * (high - low) if even else low * (high / low) ** share
        shape[item.name] = float(value)
    return replace(effect(), **shape)


def _numbers(effect: Effect) -> dict[str, float]:
    values = effect.shape_parameters.items()
    return {name: float(value) for name, value in values if not isinstance(value, tuple)}


def _conditions(run: DeviceRun, sensor: str) -> Conditions:
    """Return the conditions of a resting device in the simulated chamber."""
    rows = len(run.environment.time)
    inputs = {s: np.broadcast_to(run.true_input(s), (rows, 3)) for s in SENSORS}
    chamber = {name: getattr(run.environment, name, None) for name in CHANNELS}
    tracks: dict[str, Any] = chamber | {'supply_voltage': run.supply, 'vibration': run.vibration}
    return Conditions(
        time=run.environment.time,
        temperature=run.nodes[:, DIE],
        specific_force=inputs['accelerometer'],
        angular_velocity=inputs['gyroscope'],
        magnetic_field=inputs['magnetometer'],
        sensor=SENSORS[SENSORS.index(sensor)],
        **tracks,
    )
