# SPDX-License-Identifier: Apache-2.0
"""The modelled error of a sensor with its uncertainty, and a whole recording without it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray, ImuRecording, RecordingError
from numpy.typing import NDArray

from thermal_comp.data.binning import vibration_of
from thermal_comp.data.conditions import PER_RUN, SENSORS, Conditions, Sensor, field_conditions
from thermal_comp.effects.effect import Effect, State, columns_from
from thermal_comp.model.file import check_device, model_label
from thermal_comp.model.values import SensorModel, ThermalModel

Extrapolation = Literal['line', 'clamp']
"""Outside the fitted temperatures the error runs on as a tangent, or stays as at the edge."""
EXTRAPOLATIONS: tuple[Extrapolation, ...] = get_args(Extrapolation)
OUTSIDE_THE_RANGE: Mapping[Extrapolation, str] = {
    'line': 'extrapolated',
    'clamp': 'compensated as at the edge',
}
"""Words of a note for each way."""
DEFAULT_EXTRAPOLATION: Extrapolation = 'line'
"""Models fitted to the middle of a range err less beyond it as tangents than held at its ends, on
simulated and on measured devices: benchmarks/extrapolation.py."""
TIMEOUT_S = 10.0
"""Age from which a die temperature is not used [s]."""
ROWS_AT_A_TIME = 50_000
"""Rows taken at a time, to bound memory."""


@dataclass(frozen=True, eq=False)
class SensorError:
    """Error of n samples, its uncertainty, and the history after them."""

    error: FloatArray
    """(n, 3) to subtract [unit]; zero where no effect can be applied."""
    covariance: FloatArray
    """(n, 3, 3) of the error [unit²]: coefficients, effects not applied, extrapolation."""
    outside: NDArray[np.bool_]
    """(n,) temperature outside the fitted range: the error is extrapolated."""
    skipped: dict[str, NDArray[np.bool_]]
    """(n,) rows in which an effect was not applied for want of a channel, by effect."""
    states: tuple[State | None, ...]
    """History of each device effect."""


@dataclass(frozen=True, eq=False)
class SensorPlan:
    """The part of a sensor model that is the same for every sample."""

    effects: tuple[Effect, ...]
    """The device effects."""
    coefficients: tuple[FloatArray, ...]
    places: tuple[slice, ...]
    """Where each one's coefficients stand in the covariance."""
    covariance: FloatArray
    rms: tuple[FloatArray, ...]
    """(3,) rms of each one's error in the fit [unit]."""
    variance: FloatArray
    """(3,) variance a sample has where nothing is subtracted [unit²]."""
    low: float
    high: float
    """Fitted temperatures [°C]."""
    temperature_only: bool
    """Whether the error depends on the die temperature alone."""
    extrapolation: Extrapolation = DEFAULT_EXTRAPOLATION


def plan_of(
    model: SensorModel, extrapolation: Extrapolation = DEFAULT_EXTRAPOLATION
) -> SensorPlan:
    """Return the plan of a sensor model."""
    starts = np.cumsum([0, *(c.size for c in model.coefficients)]).tolist()
    terms = model.device_terms()
    rms = tuple(np.asarray(model.contributions.get(e.name, np.zeros(3))) for _, e, _ in terms)
    return SensorPlan(
        effects=tuple(effect for _, effect, _ in terms),
        coefficients=tuple(coefficients for _, _, coefficients in terms),
        places=tuple(slice(starts[i], starts[i + 1]) for i, _, _ in terms),
        covariance=model.covariance,
        rms=rms,
        variance=np.sum([r**2 for r in rms], axis=0) if rms else np.zeros(3),
        low=model.temperature_range[0],
        high=model.temperature_range[1],
        temperature_only=all(effect.temperature_only for _, effect, _ in terms),
        extrapolation=extrapolation,
    )


def sensor_error(
    plan: SensorPlan,
    conditions: Conditions,
    states: tuple[State | None, ...] | None = None,
    *,
    uncertain: bool = True,
) -> SensorError:
    """Return the modelled error of the device effects for rows with a finite temperature.

    Outside the fitted temperatures the model runs on as a tangent, or sees the temperature of the
    edge (`plan.extrapolation`); there the whole modelled error is taken to be uncertain in
    proportion to the distance, in units of half the range, beside the uncertainty of the
    coefficients. An effect whose channel is not known in a row adds no error there, but its rms in
    the fit to the variance. `uncertain` False saves the coefficients' part of the covariance.
    """
    n = len(conditions)
    error, variance = np.zeros((n, 3)), np.zeros((n, 3))
    held = np.minimum(np.maximum(conditions.temperature, plan.low), plan.high)
    beyond = conditions.temperature - held
    if beyond.any():
        distance = beyond / (0.5 * max(plan.high - plan.low, 1.0))
        variance += distance[:, None] ** 2 * plan.variance
        if plan.extrapolation == 'clamp':
            conditions = replace(conditions, temperature=held)
    history = list(states or (None,) * len(plan.effects))
    jacobian = np.zeros((n, 3, len(plan.covariance) if uncertain else 0))
    skipped: dict[str, NDArray[np.bool_]] = {}
    for k, effect in enumerate(plan.effects):
        # A held channel is unknown only before its first sample; history starts there.
        unknown = _unknown_rows(effect, conditions) if effect.needs else None
        first = 0 if unknown is None else int(np.argmin(unknown))
        if unknown is None or not unknown[first]:
            part = conditions.rows(slice(first, None)) if first else conditions
            columns, history[k] = columns_from(effect, part, (plan.low, plan.high), history[k])
            if unknown is not None and unknown[first:].any():
                gap = unknown[first:].reshape(-1, *[1] * (columns.ndim - 1))
                columns = np.where(gap, 0.0, columns)
            error[first:] += columns @ plan.coefficients[k]
            if uncertain:
                _fill_jacobian(jacobian[first:, :, plan.places[k]], columns)
        if unknown is not None and unknown.any():
            skipped[effect.name] = unknown
            variance += unknown[:, None] * plan.rms[k] ** 2
    covariance = np.zeros((n, 3, 3))
    if uncertain:
        covariance = jacobian @ plan.covariance @ jacobian.transpose(0, 2, 1)
    covariance[:, [0, 1, 2], [0, 1, 2]] += variance
    return SensorError(
        error=error,
        covariance=covariance,
        outside=beyond != 0.0,
        skipped=skipped,
        states=tuple(history),
    )


def has_history(model: SensorModel, conditions: Conditions) -> bool:
    """Tell whether any device effect carries a state, tried on the conditions given."""
    return any(
        effect.columns(conditions)[1] is not None
        for _, effect, _ in model.device_terms()
        if all(conditions.has(channel) for channel in effect.needs)
    )


def depends_on_time(model: SensorModel, conditions: Conditions) -> bool:
    """Tell whether a device effect's first sample depends on its time: it is tried a day later."""
    later = replace(conditions, time=conditions.time + 86_400.0)
    return any(
        not np.array_equal(effect.columns(conditions)[0], effect.columns(later)[0])
        for _, effect, _ in model.device_terms()
        if all(conditions.has(channel) for channel in effect.needs)
    )


def _unknown_rows(effect: Effect, conditions: Conditions) -> NDArray[np.bool_]:
    """Return the rows (n,) in which a channel of the effect is not known."""
    unknown = np.zeros(len(conditions), dtype=bool)
    for channel in effect.needs:
        values: Any = getattr(conditions, channel)
        if values is None:
            return np.ones(len(conditions), dtype=bool)
        if channel not in PER_RUN:
            unknown |= ~np.isfinite(values).reshape(len(unknown), -1).all(axis=1)
    return unknown


def _fill_jacobian(jacobian: FloatArray, columns: FloatArray) -> None:
    """Write d error / d coefficients (n, 3, size) of one effect, coefficients in C order."""
    if columns.ndim == 3:
        jacobian[:] = columns
        return
    for axis in range(3):
        jacobian[:, axis, axis::3] = columns


def compensate(
    recording: ImuRecording,
    model: ThermalModel,
    *,
    temperature_timeout: float = TIMEOUT_S,
    again: bool = False,
    extrapolation: Extrapolation = DEFAULT_EXTRAPOLATION,
) -> ImuRecording:
    """Return the recording with the modelled error of the device effects subtracted.

    A row takes the newest finite die temperature not later than itself; rows before the first,
    and rows whose temperature is older than `temperature_timeout` [s], are passed on. What was
    passed on, extrapolated or could not be applied is said in the notes. Raises
    RecordingError where no row has a fresh die temperature, and, unless `again`, where a model
    was subtracted before.
    """
    check_device(model, recording.device)
    if recording.compensated and not again:
        raise RecordingError(
            f'{recording.source or "recording"}: compensated already ({recording.compensated}); '
            'subtract a model from what was measured'
        )
    recording = _with_held_temperature(recording)
    known = _fresh(recording, temperature_timeout)
    conditions = model_conditions(recording, model).rows(known)
    found = {
        s: _sensor(plan_of(model.sensors[s], extrapolation), conditions.of(s))
        for s in SENSORS
        if s in model.sensors
    }
    compensated: dict[str, Any] = {}
    for sensor, part in found.items():
        values = getattr(recording, SENSOR_FIELDS[sensor]).copy()
        values[known] -= part.error
        compensated[SENSOR_FIELDS[sensor]] = values
    notes = [
        *_device_notes(recording, model),
        *_passed_on_notes(recording, known, temperature_timeout),
        *_applied_notes(model, found, extrapolation),
    ]
    applied = '; '.join(filter(None, (recording.compensated, model_label(model))))
    return replace(recording, compensated=applied, **compensated).with_notes(*notes)


def model_conditions(recording: ImuRecording, model: ThermalModel) -> Conditions:
    """Return the conditions of all rows, vibration computed where the model needs it."""
    conditions = field_conditions(recording, model.reference_temperature)
    if recording.vibration is not None or not _needs_vibration(model) or not len(recording):
        return conditions
    start = int(recording.stamp[0])
    vibration = vibration_of(recording.stamp, recording.linear_acceleration, start)
    return replace(conditions, vibration=vibration)


def _device_notes(recording: ImuRecording, model: ThermalModel) -> list[str]:
    if not model.device:
        return ['compensated with a thermal model']
    notes = [f'compensated with a thermal model of {model.device}']
    if not recording.device:
        notes.append(f'the recording does not name its device: taken to be {model.device}')
    return notes


def _passed_on_notes(
    recording: ImuRecording, known: NDArray[np.bool_], timeout: float
) -> list[str]:
    """Return why rows are passed on as they are."""
    stale = int((np.isfinite(recording.temperature) & ~known).sum())
    missing = int((~known).sum()) - stale
    notes = []
    if missing:
        notes.append(f'{missing} rows without a die temperature are passed on')
    if stale:
        notes.append(
            f'{stale} rows whose die temperature is older than {timeout:g} s are '
            'passed on (temperature_timeout)'
        )
    return notes


def _applied_notes(
    model: ThermalModel, found: Mapping[Sensor, _RowErrors], extrapolation: Extrapolation
) -> list[str]:
    """Return which effects could not be applied, and how many rows were extrapolated."""
    notes = []
    for sensor, part in found.items():
        channels = {e.name: ', '.join(e.needs) for e in model.sensors[sensor].effects}
        notes += [
            f'{sensor}: {effect} not applied in {rows} rows, {channels[effect]} is not known'
            for effect, rows in part.skipped.items()
        ]
    outside = np.any([part.outside for part in found.values()], axis=0) if found else np.zeros(1)
    if outside.any():
        how = OUTSIDE_THE_RANGE[extrapolation]
        notes.append(f'{int(outside.sum())} rows outside the fitted temperatures are {how}')
    return notes


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
class _RowErrors:
    """The error of one sensor in the rows with a fresh die temperature."""

    error: FloatArray
    """(n, 3) [unit]."""
    outside: NDArray[np.bool_]
    """(n,) temperature outside the fitted range."""
    skipped: dict[str, int]
    """Rows in which an effect was not applied, by effect."""


def _sensor(plan: SensorPlan, conditions: Conditions) -> _RowErrors:
    """Return the error of one sensor, computed a number of rows at a time."""
    error = np.empty((len(conditions), 3))
    outside = np.zeros(len(conditions), dtype=bool)
    skipped: dict[str, int] = {}
    states: tuple[State | None, ...] | None = None
    for start in range(0, len(conditions), ROWS_AT_A_TIME):
        rows = slice(start, start + ROWS_AT_A_TIME)
        part = sensor_error(plan, conditions.rows(rows), states, uncertain=False)
        error[rows], outside[rows], states = part.error, part.outside, part.states
        for name, missing in part.skipped.items():
            skipped[name] = skipped.get(name, 0) + int(missing.sum())
    return _RowErrors(error, outside, skipped)


def _needs_vibration(model: ThermalModel) -> bool:
    return any(
        'vibration' in effect.needs
        for sensor in model.sensors.values()
        for _, effect, _ in sensor.device_terms()
    )
