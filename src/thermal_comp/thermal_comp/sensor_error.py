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


def sensor_error(
    model: SensorModel, conditions: Conditions, states: tuple[State | None, ...] | None = None
) -> SensorError:
    """Return the modelled error of the device effects for rows with a finite temperature.

    The temperature is clamped to the fitted range. An effect whose channel is not known in a row
    adds nothing there but its rms in the fit to the variance.
    """
    low, high = model.temperature_range
    clamped = (conditions.temperature < low) | (conditions.temperature > high)
    outside = conditions.temperature - np.clip(conditions.temperature, low, high)
    conditions = replace(conditions, temperature=conditions.temperature - outside)
    terms = model.device_terms()
    history = list(states or (None,) * len(terms))
    n = len(conditions)
    error = np.zeros((n, 3))
    jacobian = np.zeros((n, 3, len(model.covariance)))
    variance = _extrapolation(model, outside)
    skipped: dict[str, NDArray[np.bool_]] = {}
    starts = np.cumsum([0, *(c.size for c in model.coefficients)])
    for k, (i, effect, coefficients) in enumerate(terms):
        unknown = _unknown_rows(effect, conditions)
        if not unknown.all():
            # A held channel is unknown only before its first sample; history starts there.
            first = int(np.argmin(unknown))
            columns, history[k] = effect.columns(conditions.rows(slice(first, None)), history[k])
            gap = unknown[first:].reshape(-1, *[1] * (columns.ndim - 1))
            columns = np.where(gap, 0.0, columns) if gap.any() else columns
            error[first:] += columns @ coefficients
            _fill(jacobian[first:, :, starts[i] : starts[i + 1]], columns)
        if unknown.any():
            skipped[effect.name] = unknown
            rms = model.contributions.get(effect.name, np.zeros(3))
            variance += unknown[:, None] * rms**2
    covariance = jacobian @ model.covariance @ jacobian.transpose(0, 2, 1)
    covariance[:, [0, 1, 2], [0, 1, 2]] += variance
    return SensorError(error, covariance, clamped, skipped, tuple(history))


def uncompensated_variance(model: SensorModel) -> FloatArray:
    """Return the (3,) variance a sample has where nothing was subtracted [unit²]."""
    effects = [effect.name for _, effect, _ in model.device_terms()]
    variances = [np.asarray(model.contributions.get(name, np.zeros(3))) ** 2 for name in effects]
    total: FloatArray = np.sum(variances, axis=0) if variances else np.zeros(3)
    return total


def has_history(model: SensorModel, conditions: Conditions) -> bool:
    """Tell whether any device effect carries a state, tried on the conditions given."""
    return any(
        effect.columns(conditions)[1] is not None
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


def _extrapolation(model: SensorModel, outside: FloatArray) -> FloatArray:
    """Return the (n, 3) variance for a temperature `outside` kelvin beyond the fitted range.

    The whole modelled error is taken to grow with the distance, in units of half the range.
    """
    low, high = model.temperature_range
    if not np.isfinite([low, high]).all() or high <= low:
        return np.zeros((len(outside), 3))
    share = outside / (0.5 * (high - low))
    variance: FloatArray = share[:, None] ** 2 * uncompensated_variance(model)
    return variance
