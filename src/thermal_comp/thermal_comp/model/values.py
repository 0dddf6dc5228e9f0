# SPDX-License-Identifier: Apache-2.0
"""A thermal model: effects with coefficients and their covariance, per sensor, of one device."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_UNITS, FloatArray
from imu_recording.user_error import UserError

from thermal_comp.data.conditions import REFERENCE_TEMPERATURE, Conditions
from thermal_comp.effects.effect import Effect, State
from thermal_comp.effects.user_effects import source_of
from thermal_comp.presentation.notebook import Presented

SCHEMA = 1
"""Version of the model file."""

States = tuple[State | None, ...]
"""History of each effect of a sensor model, in order."""


class ModelError(UserError):
    """A model that cannot be used; the message names the field and what is expected."""


VIBRATION_UNIT = '(m/s²)²'
"""Unit of vibration, the variance of acceleration."""


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """White noise plus Ornstein-Uhlenbeck processes of fixed correlation times, per axis.

    The sum of the processes approximates flicker noise (bias instability).
    """

    white: FloatArray
    """(3,) noise density: standard deviation of a one-second mean [unit·√s]."""
    time_constants: FloatArray
    """(k,) correlation times of the processes [s]."""
    amplitudes: FloatArray
    """(k, 3) stationary standard deviation of each process [unit]."""
    per_vibration: FloatArray = field(default_factory=lambda: np.zeros(3))
    """(3,) white variance that vibration adds: of a one-second mean, per unit of vibration beyond
    `still_vibration` [(unit)²·s/(m/s²)²]."""
    still_vibration: float = 0.0
    """Variance of the acceleration, summed over the axes, where nothing shakes [(m/s²)²]."""
    white_factors: Mapping[str, float] = field(default_factory=dict)
    """By how much the white noise of a run is larger, by run name: other ranges, counts or sample
    rates. Runs that are not named have 1; a model's file does not keep them."""
    white_weights: tuple[bool, ...] = (False, False, False)
    """Axes whose fits weigh without slow noise: held-out parts are predicted better so."""

    @property
    def weights(self) -> NoiseModel:
        """The noise that fits weigh with."""
        if not any(self.white_weights):
            return self
        return replace(self, amplitudes=np.where(self.white_weights, 0.0, self.amplitudes))

    def of_run(self, name: str) -> NoiseModel:
        """Return the noise in one run."""
        if name not in self.white_factors:
            return self
        return replace(self, white=self.white_factors[name] * self.white, white_factors={})

    def to_dict(self, unit: str) -> dict[str, Any]:
        """Return plain values with their units; what is usual is left out."""
        found: dict[str, Any] = {
            'white': {'value': self.white.tolist(), 'unit': f'{unit}·√s'},
            'time_constants': {'value': self.time_constants.tolist(), 'unit': 's'},
            'amplitudes': {'value': self.amplitudes.tolist(), 'unit': unit},
        }
        if self.per_vibration.any():
            density = {'value': self.per_vibration.tolist(), 'unit': f'({unit})²·s/(m/s²)²'}
            still = {'value': float(self.still_vibration), 'unit': VIBRATION_UNIT}
            found |= {'per_vibration': density, 'still_vibration': still}
        if any(self.white_weights):
            found['white_weights'] = list(self.white_weights)
        return found

    def added_by(self, vibration: FloatArray | None, period: float) -> FloatArray:
        """(m, 3) variance that vibration adds to means over `period` seconds [unit²].

        `vibration` (m,): variance of the acceleration within each mean, summed over the axes;
        None, where it is not known, adds nothing, (1, 3).
        """
        if vibration is None:
            return np.zeros((1, 3))
        excess = np.maximum(vibration - self.still_vibration, 0.0)
        added: FloatArray = excess[:, None] * self.per_vibration / period
        return added

    def variance_of_means(self, period: float) -> FloatArray:
        """(3,) variance of means over `period` seconds where nothing shakes [unit²].

        σ²_white / T + Σ σ_k² · 2 (r − 1 + e^{−r}) / r²,  r = T / τ_k.
        """
        r = period / self.time_constants
        share = 2.0 * (r + np.expm1(-r)) / r**2
        variance: FloatArray = self.white**2 / period + share @ self.amplitudes**2
        return variance


@dataclass(frozen=True, eq=False)
class SensorModel:
    """The modelled error of one sensor: a tuple of effects, their coefficients, the noise."""

    effects: tuple[Effect, ...]
    coefficients: tuple[FloatArray, ...]
    """One array per effect: (p, 3) per axis or (p,) shared by the axes; for effects with
    coefficients of their own in each run, (runs, p, 3) or (runs, p)."""
    covariance: FloatArray
    """(m, m) of all coefficients, each effect's array raveled in C order, in order of effects."""
    noise: NoiseModel | None = None
    levels: Mapping[str, FloatArray] = field(default_factory=dict)
    """(3,) mean output at the reference temperature of each run, by run name [unit]."""
    shape_std: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """Standard deviations of the fitted shape parameters, by `effect.parameter`."""
    shape_form_std: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """Part of them that is due to an equation only nearly right, where it is known."""
    contributions: Mapping[str, FloatArray] = field(default_factory=dict)
    """(3,) rms of each effect's error about the mean of each fitted run, by effect [unit]: so much
    stays in data where an effect cannot be applied."""
    temperature_range: tuple[float, float] = (-np.inf, np.inf)
    """Die temperatures the fit has seen [°C]; outside them the error is extrapolated."""

    def device_terms(self) -> list[tuple[int, Effect, FloatArray]]:
        """Return index, effect and coefficients of the terms that are compensated in the field."""
        terms = zip(self.effects, self.coefficients, strict=True)
        return [(i, e, c) for i, (e, c) in enumerate(terms) if e.kind == 'device']

    def modelled_error(
        self, conditions: Conditions, states: States | None = None
    ) -> tuple[FloatArray, States]:
        """Return the (n, 3) error of the device effects and their history for what follows.

        Terms whose channels are absent contribute nothing.
        """
        history = list(states or (None,) * len(self.effects))
        error = np.zeros((len(conditions), 3))
        for i, effect, coefficients in self.device_terms():
            if all(conditions.has(channel) for channel in effect.needs):
                columns, history[i] = effect.columns(conditions, history[i])
                error += columns @ coefficients
        return error, tuple(history)

    def to_dict(self, sensor: str) -> dict[str, Any]:
        """Return plain values, as they stand in the model file under the sensor's name."""
        unit = SENSOR_UNITS[sensor]
        if self.noise is None:
            raise ModelError(f'sensors.{sensor}.noise: missing; a fitted model has it')
        return {
            'unit': unit,
            'temperature_range': {'value': [*map(float, self.temperature_range)], 'unit': '°C'},
            'effects': [
                {
                    'name': effect.name,
                    **({'source': source} if (source := source_of(effect)) else {}),
                    'shape': _shape_to_dict(effect, self.shape_std, self.shape_form_std),
                    'units': [text.replace('{unit}', unit) for text in effect.coefficient_units],
                    'coefficients': coefficients.tolist(),
                    'rms': np.asarray(self.contributions.get(effect.name, np.zeros(3))).tolist(),
                }
                for effect, coefficients in zip(self.effects, self.coefficients, strict=True)
            ],
            'covariance': self.covariance.tolist(),
            'levels': {run: np.asarray(level).tolist() for run, level in self.levels.items()},
            'noise': self.noise.to_dict(unit),
        }


def _shape_to_dict(
    effect: Effect, std: Mapping[str, tuple[float, ...]], form: Mapping[str, tuple[float, ...]]
) -> dict[str, Any]:
    shape: dict[str, Any] = {}
    units = {item.name: item.metadata.get('unit', '') for item in fields(effect)}
    for name, value in effect.shape_parameters.items():
        shape[name] = {
            'value': [*map(float, value)] if isinstance(value, tuple) else float(value),
            'unit': units[name],
        }
        for key, table in (('std', std), ('form_std', form)):
            if (found := table.get(f'{effect.name}.{name}')) is not None:
                shape[name][key] = [*map(float, found)]
    return shape


@dataclass(frozen=True, eq=False)
class Provenance:
    """Where a model comes from."""

    sources: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of the decoded columns of each recording, by name."""
    version: str = ''
    """Package version that fitted it."""
    notes: tuple[str, ...] = ()
    """What was cut, dropped or assumed on the way."""


@dataclass(frozen=True, eq=False, repr=False)
class ThermalModel(Presented):
    """Thermal model of one device; `add` and `fit` return new ones and change none."""

    presentation = 'model'

    device: str
    sensors: Mapping[str, SensorModel]
    reference_temperature: float = REFERENCE_TEMPERATURE
    """[°C]."""
    pooled: bool = False
    """True where several devices were fitted together."""
    provenance: Provenance = field(default_factory=Provenance)
    history: tuple[ThermalModel, ...] = ()
    """Earlier versions, oldest first."""

    def to_dict(self) -> dict[str, Any]:
        """Return the model as the document of its file: plain mappings, lists and numbers."""
        return {
            'schema': SCHEMA,
            'device': self.device,
            'pooled': self.pooled,
            'reference_temperature': {'value': float(self.reference_temperature), 'unit': '°C'},
            'sensors': {name: part.to_dict(name) for name, part in self.sensors.items()},
            'provenance': {
                'sources': dict(self.provenance.sources),
                'version': self.provenance.version,
                'notes': list(self.provenance.notes),
            },
            'history': [earlier.to_dict() for earlier in self.history],
        }

    def succeeded_by(self, successor: ThermalModel) -> ThermalModel:
        """Return the successor with this model as the newest entry of its history."""
        earlier = replace(self, history=())
        return replace(successor, history=(*self.history, earlier))


def fitted_shapes(model: ThermalModel) -> list[dict[str, Any]]:
    """Return sensor, effect, parameter, value, std and unit of each; several values are lists.

    Parameters that are part of the form are left out.
    """
    rows: list[dict[str, Any]] = []
    for sensor, part in model.sensors.items():
        for effect in part.effects:
            for item in effect.free_parameters:
                unit = item.metadata['unit']
                value = getattr(effect, item.name)
                several = isinstance(value, tuple)
                spread = part.shape_std.get(f'{effect.name}.{item.name}', ())
                rows.append(
                    {
                        'sensor': sensor,
                        'effect': effect.name,
                        'parameter': item.name,
                        'value': list(value) if several else value,
                        'std': list(spread) if several else next(iter(spread), None),
                        'unit': unit,
                    }
                )
    return rows
