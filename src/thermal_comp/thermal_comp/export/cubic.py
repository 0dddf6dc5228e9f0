# SPDX-License-Identifier: Apache-2.0
"""The cubic in temperature that autopilots take, and the part of a model that it cannot hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import comb

import numpy as np
from imu_recording.recording import STANDARD_GRAVITY, FloatArray

from thermal_comp.comparison.compare import compare_prepared
from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.bias_temperature_curvature import BiasTemperatureCurvature
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.values import ModelError, SensorModel, ThermalModel

POLYNOMIAL_ORDER = 3
"""Order of the polynomial."""
RATE_C_PER_MIN = 2.0
"""Ramps of the cycles in which cubic and model are compared [°C/min]."""
PERIOD_S = 5.0
"""Distance of samples in them [s]."""
LONG_AFTER_S = 1e7
"""Time since power-on after which no warm-up is left [s]."""
LEAST_COST_SHARE = 1e-3
"""Cost of an effect, as a share of the correction, from which it is named."""
TYPICAL_INPUTS: Mapping[Sensor, float] = {
    'accelerometer': STANDARD_GRAVITY,
    'gyroscope': 1.0,
    'magnetometer': 5e-5,
}
"""Input on every axis for which costs of effects that depend on it are given [unit]."""


@dataclass(frozen=True, eq=False)
class Cubic:
    """Error of one sensor as a polynomial of temperature, held at the ends of its range."""

    coefficients: FloatArray
    """(4, 3) of (T − reference)^k, k = 0 … 3, per axis [unit/K^k]."""
    reference: float
    """[°C]."""
    low: float
    high: float
    """Temperatures it holds for [°C]."""

    def about(self, reference: float) -> Cubic:
        """Return the same polynomial in powers of the distance from another temperature [°C]."""
        shift = reference - self.reference
        powers = range(POLYNOMIAL_ORDER + 1)
        moved = np.array([
            sum(comb(k, j) * shift ** (k - j) * self.coefficients[k] for k in powers[j:])
            for j in powers
        ])  # fmt: skip
        return replace(self, coefficients=moved, reference=reference)

    def error(self, temperature: FloatArray) -> FloatArray:
        """Return the (n, 3) error [unit] at temperatures [°C]."""
        x = np.clip(temperature, self.low, self.high) - self.reference
        powers = x[:, None] ** np.arange(POLYNOMIAL_ORDER + 1)
        error: FloatArray = powers @ self.coefficients
        return error


@dataclass(frozen=True, eq=False)
class Loss:
    """The part of the modelled error of one sensor that a cubic leaves, in ramps of 2 K/min."""

    kept: float
    """Share of the correction's rms that the cubic keeps."""
    costs: Mapping[str, float]
    """Largest error on any axis that the cubic leaves of each effect [unit], largest first; only
    above a thousandth of the correction."""
    not_followed: tuple[str, ...]
    """Effects of channels that an autopilot does not have; their cost is their rms in the fit."""


def reduced(model: ThermalModel, sensor: Sensor) -> Cubic:
    """Return the cubic nearest to the bias of a model up and down its range at 2 K/min.

    Least squares over the second of two cycles, long after power-on; it is zero at the model's
    reference temperature, as the model's straight line and curvature are.
    """
    part = model.sensors[sensor]
    course = _course(model, sensor, inputs=0.0, start=LONG_AFTER_S)
    second = slice(len(course) // 2, None)
    error = sum(
        (_error(effect, c, course)[second] for effect, c in _followed(part)),
        start=np.zeros((len(course) - len(course) // 2, 3)),
    )
    cubic = _cubic_of(course.temperature[second], error)
    return _zero_at(cubic, model.reference_temperature)


def fitted_cubic(
    model: ThermalModel, runs: Sequence[PreparedRun]
) -> tuple[dict[Sensor, Cubic], dict[Sensor, tuple[FloatArray, FloatArray]]]:
    """Return the cubics fitted to runs, and (3,) held-out rms of cubic and of the model's effects.

    Held out are cycles or blocks, as `compare` does; what belongs to the chamber stays fitted.
    """
    full = compare_prepared(model, runs)
    effects: dict[Sensor, tuple[Effect, ...]] = {
        s: (
            BiasTemperature(),
            BiasTemperatureCurvature(),
            *(e for e in model.sensors[s].effects if e.kind != 'device'),
        )
        for s in full.sensors
    }
    other = fit_prepared(effects, runs, pooled=model.pooled, refine=False)
    compared = compare_prepared(other, runs)
    cubics: dict[Sensor, Cubic] = {}
    for sensor in effects:
        part = other.sensors[sensor]
        line, curvature = part.coefficients[:2]
        powers = np.vstack([np.zeros((1, 3)), line, curvature])
        cubic = Cubic(powers, other.reference_temperature, *part.temperature_range)
        cubics[sensor] = cubic.about(0.5 * (cubic.low + cubic.high))
    held_out = {
        s: (compared.sensors[s].held_out_rms, full.sensors[s].held_out_rms) for s in cubics
    }
    return cubics, held_out


def loss(model: ThermalModel, sensor: Sensor, cubic: Cubic) -> Loss:
    """Return the part of a model that a cubic leaves."""
    part = model.sensors[sensor]
    settled = _course(model, sensor, inputs=0.0, start=LONG_AFTER_S)
    second = slice(len(settled) // 2, None)
    terms = _followed(part)
    error = sum((_error(e, c, settled)[second] for e, c in terms), start=np.zeros(()))
    left = error - cubic.error(settled.temperature[second])
    kept = 1.0 - _rms(left) / _rms(error) if terms and _rms(error) > 0.0 else 0.0
    from_start = _course(model, sensor, inputs=TYPICAL_INPUTS[sensor], start=0.0)
    costs = {}
    for effect, coefficients in terms:
        whole = _error(effect, coefficients, settled)[second]
        curve = _cubic_of(settled.temperature[second], whole)
        acting = _error(effect, coefficients, from_start)
        costs[effect.name] = float(np.abs(acting - curve.error(from_start.temperature)).max())
    not_followed = [e for _, e, _ in part.device_terms() if e.needs]
    for effect in not_followed:
        costs[effect.name] = float(np.max(part.contributions.get(effect.name, np.zeros(3))))
    least = LEAST_COST_SHARE * max([float(np.abs(error).max()), *costs.values()])
    ordered = sorted((k for k in costs.items() if k[1] > least), key=lambda item: -item[1])
    return Loss(max(0.0, kept), dict(ordered), tuple(e.name for e in not_followed))


def _followed(part: SensorModel) -> list[tuple[Effect, FloatArray]]:
    """Return the device effects without channels, and their coefficients."""
    return [(e, c) for _, e, c in part.device_terms() if not e.needs]


def _error(effect: Effect, coefficients: FloatArray, course: Conditions) -> FloatArray:
    error: FloatArray = effect.columns(course)[0] @ coefficients
    return error


def _range(part: SensorModel, sensor: Sensor) -> tuple[float, float]:
    low, high = map(float, part.temperature_range)
    if not (np.isfinite([low, high]).all() and high - low > 1.0):
        raise ModelError(
            f'sensors.{sensor}.temperature_range: {low:g} … {high:g} °C is no range for a curve'
        )
    return low, high


def _course(model: ThermalModel, sensor: Sensor, *, inputs: float, start: float) -> Conditions:
    """Return two cycles up and down the fitted range."""
    low, high = _range(model.sensors[sensor], sensor)
    rows = max(4, round((high - low) / RATE_C_PER_MIN * 60.0 / PERIOD_S))
    up = np.linspace(low, high, rows, endpoint=False)
    temperature = np.concatenate([up, up[::-1] + (high - low) / rows] * 2)
    n = len(temperature)
    acting = np.full((n, 3), inputs)
    return Conditions(
        time=start + PERIOD_S * np.arange(n, dtype=np.float64),
        temperature=temperature,
        specific_force=acting if sensor != 'gyroscope' else acting * STANDARD_GRAVITY,
        angular_velocity=acting,
        magnetic_field=acting,
        sensor=sensor,
        reference_temperature=model.reference_temperature,
    )


def _cubic_of(temperature: FloatArray, error: FloatArray) -> Cubic:
    """Return the cubic of least squares to an error (n, 3), about the middle of the range."""
    low, high = float(temperature.min()), float(temperature.max())
    middle, span = 0.5 * (low + high), high - low
    x = (temperature - middle) / span
    fitted = np.linalg.lstsq(x[:, None] ** np.arange(POLYNOMIAL_ORDER + 1), error)[0]
    coefficients = fitted / span ** np.arange(POLYNOMIAL_ORDER + 1)[:, None]
    return Cubic(coefficients=coefficients, reference=middle, low=low, high=high)


def _zero_at(cubic: Cubic, temperature: float) -> Cubic:
    """Return the cubic moved so that it is zero at a temperature, inside its range or not."""
    coefficients = cubic.coefficients.copy()
    coefficients[0] -= cubic.error(np.array([temperature]))[0]
    return replace(cubic, coefficients=coefficients)


def _rms(values: FloatArray) -> float:
    """Return the rms over rows and axes about the mean of each axis."""
    return float(np.sqrt(np.mean((values - values.mean(axis=0)) ** 2)))
