# SPDX-License-Identifier: Apache-2.0
"""A thermal model from plain mappings, lists and numbers, every field checked on the way in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_UNITS, FloatArray

from thermal_comp.conditions import CHANNELS, SENSORS, Conditions, Sensor
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.model import ModelError, NoiseModel, Provenance, SensorModel, ThermalModel
from thermal_comp.model_field import Field

SCHEMA = 1
ROOT_FIELDS = (
    'schema',
    'device',
    'pooled',
    'reference_temperature',
    'sensors',
    'provenance',
    'history',
)
SENSOR_FIELDS = ('unit', 'temperature_range', 'effects', 'covariance', 'levels', 'noise')
EFFECT_FIELDS = ('name', 'shape', 'units', 'coefficients', 'rms')


def model_from_document(
    document: Any, effects: Mapping[str, type[Effect]] = EFFECTS
) -> ThermalModel:
    """Return the model of a document, checked field by field."""
    root = Field(document)
    schema = root['schema']
    if schema.value != SCHEMA:
        raise schema.refuse(f'is {schema.value!r}, this version reads {SCHEMA}')
    root.only(*ROOT_FIELDS)
    reference = root['reference_temperature']
    reference.only('value', 'unit')
    _check_unit(reference, '°C')
    sensors: dict[str, SensorModel] = {}
    for name, entry in root['sensors'].entries().items():
        if name not in SENSOR_UNITS:
            raise entry.refuse(f'no such sensor; there are {", ".join(SENSORS)}')
        sensors[name] = _sensor(entry, SENSORS[SENSORS.index(name)], effects)
    if not sensors:
        raise root['sensors'].refuse('holds no sensor')
    provenance = root['provenance']
    provenance.only('sources', 'version', 'notes')
    sources = provenance['sources'].entries()
    return ThermalModel(
        device=root['device'].text(),
        sensors=sensors,
        reference_temperature=reference['value'].number(),
        pooled=root['pooled'].flag(),
        provenance=Provenance(
            sources={name: source.text() for name, source in sources.items()},
            version=provenance['version'].text(),
            notes=tuple(note.text() for note in provenance.get('notes', []).items()),
        ),
        history=tuple(
            model_from_document(item.value, effects) for item in root.get('history', []).items()
        ),
    )


def _sensor(entry: Field, sensor: Sensor, catalogue: Mapping[str, type[Effect]]) -> SensorModel:
    unit = SENSOR_UNITS[sensor]
    entry.only(*SENSOR_FIELDS)
    _check_unit(entry, unit)
    found: list[Effect] = []
    coefficients: list[FloatArray] = []
    std: dict[str, tuple[float, ...]] = {}
    rms: dict[str, FloatArray] = {}
    for item in entry['effects'].items():
        effect = _effect(item, catalogue, std)
        if effect.name in rms:
            raise item['name'].refuse(f'{effect.name!r} is there twice')
        found.append(effect)
        rms[effect.name] = item.get('rms', [0.0, 0.0, 0.0]).array(3)
        coefficients.append(_coefficients(item['coefficients'], effect, sensor))
    size = sum(c.size for c in coefficients)
    return SensorModel(
        effects=tuple(found),
        coefficients=tuple(coefficients),
        covariance=_covariance(entry['covariance'], size),
        noise=_noise(entry['noise'], unit),
        levels={run: level.array(3) for run, level in entry.get('levels', {}).entries().items()},
        shape_std=std,
        contributions=rms,
        temperature_range=_range(entry['temperature_range']),
    )


def _effect(
    item: Field, catalogue: Mapping[str, type[Effect]], std: dict[str, tuple[float, ...]]
) -> Effect:
    item.only(*EFFECT_FIELDS)
    name = item['name'].text()
    if name not in catalogue:
        raise item['name'].refuse(
            f'{name!r} is not in the catalogue; if it is an effect of your own, give its file '
            'with --effects'
        )
    known = {f.name: f for f in fields(catalogue[name])}
    shape: dict[str, Any] = {}
    for key, entry in item.get('shape', {}).entries().items():
        if key not in known:
            raise entry.refuse(f'{name} has no such parameter; it has {", ".join(known)}')
        entry.only('value', 'unit', 'std')
        _check_unit(entry, known[key].metadata.get('unit', ''))
        values = entry['value'].array()
        low, high = known[key].metadata.get('bounds', (-np.inf, np.inf))
        # The ends of the range may be off by a rounding of the search scale.
        slack = 1e-9 * max(abs(low), abs(high)) if np.isfinite([low, high]).all() else 0.0
        if not ((low - slack <= values) & (values <= high + slack)).all():
            raise entry['value'].refuse(f'is {entry["value"].value}, expected {low:g} … {high:g}')
        shape[key] = tuple(values.tolist()) if values.ndim else float(values)
        if 'std' in entry.mapping():
            std[f'{name}.{key}'] = tuple(entry['std'].array(None).tolist())
    for key in known:
        if key not in shape:
            raise ModelError(f'{item.name}.shape.{key}: missing')
    return catalogue[name](**shape)


def _coefficients(entry: Field, effect: Effect, sensor: Sensor) -> FloatArray:
    """Return the coefficients, of the shape the effect's own columns ask for."""
    width, shared = _columns_of(effect, sensor)
    shape: tuple[int | None, ...] = (width,) if shared else (width, 3)
    if not shape[0] and entry.value == []:
        return np.zeros((0, 3))
    return entry.array(*((None, *shape) if effect.per_run else shape))


def _columns_of(effect: Effect, sensor: Sensor) -> tuple[int, bool]:
    """Return number of columns and whether the axes share them, tried on two samples."""
    ramp, still = np.array([0.0, 1.0]), np.zeros((2, 3))
    conditions = Conditions(
        time=ramp,
        temperature=20.0 + ramp,
        specific_force=still,
        angular_velocity=still,
        magnetic_field=still,
        sensor=sensor,
        orientation=np.eye(3),
        vibration=still,
        phase=np.zeros(2, dtype=np.int64),
        cycle=np.ones(2, dtype=np.int64),
    )
    absent: dict[str, Any] = {c: ramp for c in CHANNELS if getattr(conditions, c) is None}
    conditions = replace(conditions, **absent)
    columns = effect.columns(conditions)[0]
    return columns.shape[-1], columns.ndim == 3


def _covariance(entry: Field, size: int) -> FloatArray:
    if not size:
        return np.zeros((0, 0))
    covariance = entry.array(size, size)
    scale = np.sqrt(np.abs(np.outer(np.diag(covariance), np.diag(covariance))))
    if (np.abs(covariance - covariance.T) > 1e-9 * scale).any():
        raise entry.refuse('is not symmetric')
    if (np.diag(covariance) < 0.0).any():
        raise entry.refuse('has a negative variance')
    return covariance


def _noise(entry: Field, unit: str) -> NoiseModel:
    units = {'white': f'{unit}·√s', 'time_constants': 's', 'amplitudes': unit}
    entry.only(*units)
    for key, expected in units.items():
        entry[key].only('value', 'unit')
        _check_unit(entry[key], expected)
    times = entry['time_constants']['value'].array(None)
    if (times <= 0.0).any():
        raise entry['time_constants'].refuse('has a value that is not positive')
    white = entry['white']['value'].array(3)
    amplitudes = entry['amplitudes']['value'].array(len(times), 3)
    for key, values in (('white', white), ('amplitudes', amplitudes)):
        if (values < 0.0).any():
            raise entry[key].refuse('has a negative standard deviation')
    return NoiseModel(white=white, time_constants=times, amplitudes=amplitudes)


def _range(entry: Field) -> tuple[float, float]:
    entry.only('value', 'unit')
    _check_unit(entry, '°C')
    low, high = entry['value'].array(2)
    if low > high:
        raise entry.refuse(f'is {low:g} … {high:g}: the lower end comes first')
    return float(low), float(high)


def _check_unit(entry: Field, unit: str) -> None:
    found = entry['unit']
    if found.value != unit:
        raise found.refuse(f'is {found.value!r}, expected {unit!r}')
