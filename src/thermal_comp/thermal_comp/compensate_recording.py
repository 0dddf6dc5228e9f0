# SPDX-License-Identifier: Apache-2.0
"""Subtract the modelled error from a whole recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from imu_recording.recording import (
    SENSOR_FIELDS,
    FloatArray,
    ImuRecording,
    RecordingError,
)
from numpy.typing import NDArray

from thermal_comp.conditions import SENSORS, Conditions, field_conditions
from thermal_comp.effects.effect import State
from thermal_comp.model import ThermalModel
from thermal_comp.model_file import check_device
from thermal_comp.sensor_error import plan_of, sensor_error
from thermal_comp.vibration import vibration_of

TIMEOUT_S = 10.0
"""Age from which a die temperature is not used [s]."""
PIECE = 50_000
"""Rows taken at a time, to bound memory."""


def compensate(
    recording: ImuRecording, model: ThermalModel, *, temperature_timeout: float = TIMEOUT_S
) -> ImuRecording:
    """Return the recording with the modelled error of the device effects subtracted.

    A row takes the newest finite die temperature not later than itself; rows before the first,
    and rows whose temperature is older than `temperature_timeout` [s], are passed on. What was
    passed on, clamped to the fitted range or could not be applied is said in the notes. Raises
    RecordingError where no row has a fresh die temperature.
    """
    check_device(model, recording.device)
    recording = _with_held_temperature(recording)
    known = _fresh(recording, temperature_timeout)
    stale = int((np.isfinite(recording.temperature) & ~known).sum())
    conditions = field_conditions(recording, model.reference_temperature)
    if recording.vibration is None and _needs_vibration(model) and len(recording):
        vibration = vibration_of(
            recording.stamp, recording.linear_acceleration, int(recording.stamp[0])
        )
        conditions = replace(conditions, vibration=vibration)
    conditions = conditions.rows(known)
    notes = ['compensated with a thermal model' + (f' of {model.device}' if model.device else '')]
    if model.device and not recording.device:
        notes.append(f'the recording does not name its device: taken to be {model.device}')
    if missing := int((~known).sum()) - stale:
        notes.append(f'{missing} rows without a die temperature are passed on')
    if stale:
        notes.append(
            f'{stale} rows whose die temperature is older than {temperature_timeout:g} s are '
            'passed on (temperature_timeout)'
        )
    changed: dict[str, Any] = {}
    outside = np.zeros(int(known.sum()), dtype=bool)
    for sensor in SENSORS:
        name = SENSOR_FIELDS[sensor]
        if sensor in model.sensors:
            found = _sensor(model, conditions.of(sensor))
            values = getattr(recording, name).copy()
            values[known] -= found.error
            changed[name] = values
            outside |= found.outside
            needed = {e.name: ', '.join(e.channels) for e in model.sensors[sensor].effects}
            notes += [
                f'{sensor}: {effect} not applied in {rows} rows, {needed[effect]} is not known'
                for effect, rows in found.skipped.items()
            ]
    if outside.any():
        notes.append(f'{int(outside.sum())} rows outside the fitted temperatures are clamped')
    return replace(recording, **changed).with_notes(*notes)


def _with_held_temperature(recording: ImuRecording) -> ImuRecording:
    """Give every row the newest finite die temperature not later than itself, and its stamp."""
    finite = np.isfinite(recording.temperature)
    if finite.all():
        return recording
    newest = np.maximum.accumulate(np.where(finite, np.arange(len(finite)), -1))
    measured = recording.temperature_stamp
    stamp = (recording.stamp if measured is None else measured)[newest]
    return replace(
        recording,
        temperature=np.where(newest >= 0, recording.temperature[newest], np.nan),
        temperature_stamp=np.where(newest >= 0, stamp, -1),
    )


def _fresh(recording: ImuRecording, timeout: float) -> NDArray[np.bool_]:
    """Return which rows have a die temperature that is not older than `timeout` [s]."""
    known = np.isfinite(recording.temperature)
    source = recording.source or 'recording'
    if len(recording) and not known.any():
        raise RecordingError(
            f'{source}: no die temperature to compensate with; record imu/temperature too'
        )
    if recording.temperature_stamp is None:
        return known
    fresh = known & (recording.stamp - recording.temperature_stamp <= round(timeout * 1e9))
    if len(recording) and not fresh.any():
        raise RecordingError(
            f'{source}: every die temperature is older than {timeout:g} s; '
            'allow more with temperature_timeout'
        )
    return fresh


@dataclass(frozen=True, eq=False)
class _Found:
    error: FloatArray
    outside: np.ndarray
    skipped: dict[str, int]


def _sensor(model: ThermalModel, conditions: Conditions) -> _Found:
    error = np.empty((len(conditions), 3))
    outside = np.zeros(len(conditions), dtype=bool)
    skipped: dict[str, int] = {}
    plan = plan_of(model.sensors[conditions.sensor])
    states: tuple[State | None, ...] | None = None
    for start in range(0, len(conditions), PIECE):
        rows = slice(start, start + PIECE)
        part = sensor_error(plan, conditions.rows(rows), states, uncertain=False)
        error[rows], outside[rows], states = part.error, part.clamped, part.states
        for name, missing in part.skipped.items():
            skipped[name] = skipped.get(name, 0) + int(missing.sum())
    return _Found(error, outside, skipped)


def _needs_vibration(model: ThermalModel) -> bool:
    return any(
        'vibration' in effect.channels
        for sensor in model.sensors.values()
        for _, effect, _ in sensor.device_terms()
    )
