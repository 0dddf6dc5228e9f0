# SPDX-License-Identifier: Apache-2.0
"""A thermal model as plain values: terms with uncertainty, range, versions."""

from __future__ import annotations

from typing import Any

import numpy as np
from thermal_comp.model.values import SensorModel, ThermalModel, fitted_shapes


def model_content(model: ThermalModel) -> dict[str, Any]:
    """Return the terms of a model in SI units, its range and how it came about."""
    ranges = [part.temperature_range for part in model.sensors.values()]
    versions = [*model.history, model]
    return {
        'device': model.device,
        'pooled': model.pooled,
        'reference_temperature': model.reference_temperature,
        'temperature_range': [
            min((low for low, _ in ranges), default=None),
            max((high for _, high in ranges), default=None),
        ],
        'terms': [
            term for sensor, part in model.sensors.items() for term in sensor_terms(sensor, part)
        ],
        'shapes': fitted_shapes(model),
        'history': [
            {
                'name': name,
                'effects': effects_line(version),
                'bags': len(version.provenance.sources),
                'package': version.provenance.version,
            }
            for name, version in zip(version_names(model), versions, strict=True)
        ],
        'provenance': {
            'sources': dict(model.provenance.sources),
            'version': model.provenance.version,
            'notes': list(model.provenance.notes),
        },
    }


def sensor_terms(sensor: str, part: SensorModel) -> list[dict[str, Any]]:
    """Return one row per column of every effect: three values with standard uncertainties.

    Terms with coefficients of their own in each run are summed up in their mean.
    """
    unit = {'gyroscope': 'rad/s', 'accelerometer': 'm/s²', 'magnetometer': 'T'}[sensor]
    deviation = np.sqrt(np.maximum(np.diag(part.covariance), 0.0))
    rows, start = [], 0
    for effect, coefficients in zip(part.effects, part.coefficients, strict=True):
        size = coefficients.size
        uncertainty = deviation[start : start + size].reshape(coefficients.shape)
        start += size
        values, own = coefficients, uncertainty
        if effect.per_run:
            values, own = values.mean(axis=0), np.sqrt((own**2).mean(axis=0))
        shared = values.ndim == 1
        if shared:
            values, own = (np.repeat(a[:, None], 3, axis=1) for a in (values, own))
        labels = effect.coefficient_labels(len(values))
        units = effect.units_of_coefficients(len(values), unit)
        for number, (value, sigma) in enumerate(zip(values, own, strict=True)):
            rows.append(
                {
                    'sensor': sensor,
                    'effect': labels[number],
                    'shared': shared,
                    'value': value,
                    'uncertainty': sigma,
                    'unit': units[number],
                    'shape': effect.shape_parameters,
                }
            )
    return rows


def in_words(coefficient: str) -> str:
    """Return a coefficient's label with its effect's name in words; its symbol stays.

    >>> in_words('scale_factor_temperature, s_x')
    'scale factor temperature, s_x'
    """
    effect, comma, symbol = coefficient.partition(', ')
    return f'{effect.replace("_", " ")}{comma}{symbol}'


def effects_line(model: ThermalModel) -> str:
    """Return the effects of a version in one line."""
    parts = []
    for sensor, part in model.sensors.items():
        names = ', '.join(effect.name.replace('_', ' ') for effect in part.effects)
        parts.append(f'{sensor}: {names or "nothing"}')
    return '; '.join(parts)


def version_names(model: ThermalModel) -> list[str]:
    """Return a name for every version, oldest first: `bias temperature`, `+ thermal lag` …"""
    names: list[str] = []
    before: list[str] = []
    for version in (*model.history, model):
        effects = _effect_names(version)
        added = [effect for effect in effects if effect not in before]
        gone = [effect for effect in before if effect not in effects]
        parts = [*added, *(f'without {effect}' for effect in gone)]
        text = ' + '.join(parts) or ('refitted' if names else 'levels only')
        names.append(f'+ {text}' if names and added else text)
        before = effects
    return names


def _effect_names(model: ThermalModel) -> list[str]:
    """Return the effects of a version over all sensors, each once."""
    found = (effect.name for part in model.sensors.values() for effect in part.effects)
    return [name.replace('_', ' ') for name in dict.fromkeys(found)]
