# SPDX-License-Identifier: Apache-2.0
"""The modelled error of one sensor and its uncertainty: one function for bag and node."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray

from thermal_comp.conditions import Conditions
from thermal_comp.effects.effect import Effect, State
from thermal_comp.model import SensorModel


@dataclass(frozen=True, eq=False)
class SensorError:
    """Error of n samples and what is known about it."""

    error: FloatArray
    """(n, 3) to subtract [unit]; zero where nothing can be said."""
    covariance: FloatArray
    """(n, 3, 3) of the error [unit²]: coefficients, effects not applied, extrapolation."""
    clamped: NDArray[np.bool_]
    """(n,) temperature outside the fitted range."""
    skipped: dict[str, NDArray[np.bool_]]
    """(n,) where each effect was not applied for want of a channel, by effect; only such ones."""
    states: tuple[State | None, ...]
    """History of each device effect."""


@dataclass(frozen=True, eq=False)
class SensorPlan:
    """What a sensor model says about every sample alike."""

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


def plan_of(model: SensorModel) -> SensorPlan:
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
    )


def sensor_error(
    plan: SensorPlan,
    conditions: Conditions,
    states: tuple[State | None, ...] | None = None,
    *,
    uncertain: bool = True,
) -> SensorError:
    """Return the modelled error of the device effects for rows with a finite temperature.

    The temperature is clamped to the fitted range; beyond it the whole modelled error is taken to
    be uncertain in proportion to the distance, in units of half the range. An effect whose
    channel is not known in a row adds nothing there but its rms in the fit to the variance.
    `uncertain` False saves the coefficients' part of the covariance.
    """
    n = len(conditions)
    error, variance = np.zeros((n, 3)), np.zeros((n, 3))
    limited = np.minimum(np.maximum(conditions.temperature, plan.low), plan.high)
    clamped = limited != conditions.temperature
    if clamped.any():
        outside = (conditions.temperature - limited) / (0.5 * max(plan.high - plan.low, 1.0))
        variance += outside[:, None] ** 2 * plan.variance
        conditions = replace(conditions, temperature=limited)
    history = list(states or (None,) * len(plan.effects))
    jacobian = np.zeros((n, 3, len(plan.covariance) if uncertain else 0))
    skipped: dict[str, NDArray[np.bool_]] = {}
    for k, effect in enumerate(plan.effects):
        # A held channel is unknown only before its first sample; history starts there.
        unknown = _unknown_rows(effect, conditions) if effect.channels else None
        first = 0 if unknown is None else int(np.argmin(unknown))
        if unknown is None or not unknown[first]:
            part = conditions.rows(slice(first, None)) if first else conditions
            columns, history[k] = effect.columns(part, history[k])
            if unknown is not None and unknown[first:].any():
                gap = unknown[first:].reshape(-1, *[1] * (columns.ndim - 1))
                columns = np.where(gap, 0.0, columns)
            error[first:] += columns @ plan.coefficients[k]
            if uncertain:
                _fill(jacobian[first:, :, plan.places[k]], columns)
        if unknown is not None and unknown.any():
            skipped[effect.name] = unknown
            variance += unknown[:, None] * plan.rms[k] ** 2
    covariance = np.zeros((n, 3, 3))
    if uncertain:
        covariance = jacobian @ plan.covariance @ jacobian.transpose(0, 2, 1)
    covariance[:, [0, 1, 2], [0, 1, 2]] += variance
    return SensorError(error, covariance, clamped, skipped, tuple(history))


def has_history(model: SensorModel, conditions: Conditions) -> bool:
    """Tell whether any device effect carries a state, tried on the conditions given."""
    return any(
        effect.columns(conditions)[1] is not None
        for _, effect, _ in model.device_terms()
        if all(conditions.has(channel) for channel in effect.channels)
    )


def depends_on_time(model: SensorModel, conditions: Conditions) -> bool:
    """Tell whether a device effect's first sample depends on when it is, by a day's difference."""
    later = replace(conditions, time=conditions.time + 86_400.0)
    return any(
        not np.array_equal(effect.columns(conditions)[0], effect.columns(later)[0])
        for _, effect, _ in model.device_terms()
        if all(conditions.has(channel) for channel in effect.channels)
    )


def _unknown_rows(effect: Effect, conditions: Conditions) -> NDArray[np.bool_]:
    unknown = np.zeros(len(conditions), dtype=bool)
    for channel in effect.channels:
        values: Any = getattr(conditions, channel)
        if values is None:
            return np.ones(len(conditions), dtype=bool)
        if channel != 'orientation':
            unknown |= ~np.isfinite(values).reshape(len(unknown), -1).all(axis=1)
    return unknown


def _fill(jacobian: FloatArray, columns: FloatArray) -> None:
    """Write d error / d coefficients (n, 3, size) of one effect, coefficients in C order."""
    if columns.ndim == 3:
        jacobian[:] = columns
        return
    for axis in range(3):
        jacobian[:, axis, axis::3] = columns
