# SPDX-License-Identifier: Apache-2.0
"""Test vectors of an exported model: what this package subtracts, sample by sample."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording

from thermal_comp.compensation.recording import model_conditions, plan_of, sensor_error
from thermal_comp.data.conditions import TABLE_ORDER, Conditions
from thermal_comp.effects.contract import example_conditions
from thermal_comp.model.values import ModelError, ThermalModel

BEYOND_K = 5.0
"""How far the example course leaves the fitted temperatures [K]."""


def example_course(model: ThermalModel) -> Conditions:
    """Return 600 irregular samples of two swings through the fitted temperatures and beyond."""
    example = example_conditions()
    ranges = [part.temperature_range for part in model.sensors.values()]
    low, high = min(r[0] for r in ranges) - BEYOND_K, max(r[1] for r in ranges) + BEYOND_K
    swing = (example.temperature - 20.0) / 30.0
    temperature = 0.5 * (low + high) + 0.5 * (high - low) * swing
    return replace(
        example,
        temperature=temperature,
        time=np.round(example.time - example.time[0], 9),
        reference_temperature=model.reference_temperature,
    )


def recorded_course(model: ThermalModel, recording: ImuRecording) -> Conditions:
    """Return the conditions in which a recording would be compensated."""
    conditions = model_conditions(recording, model)
    known = np.isfinite(conditions.temperature)
    if not known.any():
        raise ModelError(f'{recording.source or "recording"}: no die temperature')
    return conditions.rows(known)


def vectors_text(
    model: ThermalModel, channels: Mapping[str, int], courses: Iterable[Conditions]
) -> str:
    """Return one line per sample: t [ns], temperature, the sample, the nine errors to subtract.

    Each course starts at 0 ns; time that jumps back starts the history anew.
    """
    names = ['t', 'temperature', *(f'{s}_{a}' for s in TABLE_ORDER for a in 'xyz'), *channels]
    names += [f'error_of_{s}_{a}' for s in TABLE_ORDER for a in 'xyz']
    lines = [f'# {" ".join(names)}']
    for course in courses:
        rows = np.concatenate([_sample(course, channels), _errors(model, course)], axis=1)
        start = course.time[0]
        lines += [
            f'{round((time - start) * 1e9)} {" ".join(map(repr, row))}'
            for time, row in zip(course.time.tolist(), rows.tolist(), strict=True)
        ]
    return '\n'.join(lines) + '\n'


def _sample(course: Conditions, channels: Mapping[str, int]) -> FloatArray:
    unknown = np.full(len(course), np.nan)
    columns = [course.temperature[:, None]]
    columns += [course.of(sensor).true_input for sensor in TABLE_ORDER]
    for name, components in channels.items():
        values = getattr(course, name)
        held = np.tile(unknown[:, None], components) if values is None else values
        columns.append(np.reshape(held, (len(course), components)))
    return np.concatenate(columns, axis=1)


def _errors(model: ThermalModel, course: Conditions) -> FloatArray:
    errors = [
        sensor_error(plan_of(model.sensors[s]), course.of(s), uncertain=False).error
        if s in model.sensors
        else np.zeros((len(course), 3))
        for s in TABLE_ORDER
    ]
    return np.concatenate(errors, axis=1)
