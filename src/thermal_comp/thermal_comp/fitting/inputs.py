# SPDX-License-Identifier: Apache-2.0
"""The runs and effects a fit accepts: one device, a span of temperature, sensors, channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.model.values import ModelError
from thermal_comp.noise.of_runs import LEAST_NOISE_SHARE

Effects = Sequence[Effect] | Mapping[Sensor, Sequence[Effect]]
"""One list for all sensors (each takes those that can act on it), or one per sensor."""

LEAST_SPAN_K = 2.0
"""Least span of die temperature [K] a model can be fitted to."""


def device_of(runs: Sequence[PreparedRun], *, pooled: bool = False) -> str:
    """Return the device of the runs; refuse an empty list, mixed devices and a run given twice."""
    if not runs:
        raise ModelError('no recordings given; a fit needs at least one run')
    seen: dict[str, str] = {}
    for run in runs:
        if run.hash in seen:
            raise ModelError(f'runs {seen[run.hash]} and {run.name} hold the same data')
        seen[run.hash] = run.name
    devices = sorted({run.device for run in runs})
    if len(devices) > 1 and not pooled:
        names = ', '.join(device or '(not named)' for device in devices)
        raise ModelError(
            f'the recordings are of several devices: {names}; '
            'fit each by itself, give one device one name (import --device NAME), or fit all '
            'together (fit --pooled)'
        )
    return '+'.join(devices)


def check_temperature(runs: Sequence[PreparedRun]) -> tuple[float, float]:
    """Return the range of die temperature [°C]; refuse one too small to show a dependence."""
    low = min(float(run.conditions.temperature.min()) for run in runs)
    high = max(float(run.conditions.temperature.max()) for run in runs)
    if high - low < LEAST_SPAN_K:
        raise ModelError(
            f'the die temperature stays within {low:.2f} … {high:.2f} °C; '
            f'a thermal model needs a span of at least {LEAST_SPAN_K:g} K'
        )
    return low, high


def usable_sensors(runs: Sequence[PreparedRun]) -> tuple[list[Sensor], list[str]]:
    """Return the sensors that every run has measured, and why others are left out."""
    sensors: list[Sensor] = []
    notes = []
    for sensor in SENSORS:
        reason = next(filter(None, (_unusable(run, sensor) for run in runs)), '')
        if reason:
            notes.append(f'{sensor} left out: {reason}')
        else:
            sensors.append(sensor)
    if not sensors:
        raise ModelError('; '.join(notes))
    return sensors, notes


def _unusable(run: PreparedRun, sensor: Sensor) -> str:
    """Return why a run's sensor cannot be fitted, '' where it can."""
    values = run.measured[sensor]
    values = values[run.valid(sensor)]
    if len(values) < 2 * len(values.T):
        found = f'only {len(values)} blocks' if len(values) else 'nothing'
        return f'run {run.name} has {found} of it'
    finest = LEAST_NOISE_SHARE * np.abs(values).max(
        axis=0
    )  # means of equal values differ by rounding
    moves = np.ptp(values, axis=0) > finest
    constant = [axis for axis, moving in zip('xyz', moves, strict=True) if not moving]
    axes = f'{"axes" if len(constant) > 1 else "axis"} {", ".join(constant)}'
    return f'{axes} of run {run.name} never change{"s" * (len(constant) == 1)}' if constant else ''


def effects_by_sensor(
    effects: Effects, sensors: Sequence[Sensor], runs: Sequence[PreparedRun]
) -> dict[Sensor, tuple[Effect, ...]]:
    """Return the effects of each sensor, checked: known channels, none twice, sensor allowed."""
    listed: dict[Sensor, tuple[Effect, ...]] = {}
    for sensor in sensors:
        if isinstance(effects, Mapping):
            chosen = tuple(effects.get(sensor, ()))
        else:
            chosen = tuple(e for e in effects if sensor in e.sensors)
        names = [e.name for e in chosen]
        for effect in chosen:
            if sensor not in effect.sensors:
                raise ModelError(
                    f'{effect.name} does not act on the {sensor}, only on '
                    f'{", ".join(effect.sensors)}'
                )
            if names.count(effect.name) > 1:
                raise ModelError(f'{effect.name} is listed twice for the {sensor}')
            for run in runs:
                missing = [c for c in effect.needs if not run.conditions.has(c)]
                if missing:
                    raise ModelError(
                        f'{effect.name} needs {missing[0]}, which run {run.name} has not '
                        'logged; leave the effect out'
                    )
        listed[sensor] = chosen
    return listed


def sensor_groups(listed: Mapping[Sensor, tuple[Effect, ...]]) -> list[tuple[Sensor, ...]]:
    """Return the sensors in groups that share the coefficients of a coupled effect."""
    groups: list[tuple[Sensor, ...]] = []
    for sensor, effects in listed.items():
        coupled = {e for e in effects if e.coupled}
        joined = [g for g in groups if coupled & {e for s in g for e in listed[s]}]
        merged = (*(s for g in joined for s in g), sensor)
        groups = [g for g in groups if g not in joined] + [merged]
    return groups
