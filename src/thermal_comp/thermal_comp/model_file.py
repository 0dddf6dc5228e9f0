# SPDX-License-Identifier: Apache-2.0
"""Thermal models as YAML: every number exact, every field checked on the way in."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
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


def save_model(model: ThermalModel, path: str | os.PathLike[str]) -> None:
    """Write the model as YAML; reading it back gives the same numbers, bit for bit."""
    text = yaml.dump(
        model_document(model),
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        default_flow_style=None,
        width=110,
    )
    Path(path).write_text(text, 'utf-8')


def load_model(
    path: str | os.PathLike[str], effects: Mapping[str, type[Effect]] = EFFECTS
) -> ThermalModel:
    """Read a model; raise ModelError that names the file, the field and what is expected."""
    try:
        document = yaml.load(Path(path).read_text('utf-8'), Loader=_Loader)  # noqa: S506 (safe)
    except OSError as error:
        raise ModelError(f'{path}: {error.strerror}') from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        reason = ' '.join(str(error).split())
        raise ModelError(f'{path}: not a YAML file: {reason}') from None
    try:
        return model_from_document(document, effects)
    except ModelError as error:
        raise ModelError(f'{path}: {error}') from None


def check_device(model: ThermalModel, device: str) -> None:
    """Refuse a recording of another device; one whose device is not named passes."""
    known = model.device.split('+') if model.pooled else [model.device]
    if device and model.device and device not in known:
        raise ModelError(
            f'device: the model is of {model.device}, the recording of {device}; '
            'fit a model of that device, or several together with --pooled'
        )


def model_document(model: ThermalModel) -> dict[str, Any]:
    """Return the model as plain mappings, lists and numbers."""
    return {
        'schema': SCHEMA,
        'device': model.device,
        'pooled': model.pooled,
        'reference_temperature': {'value': float(model.reference_temperature), 'unit': '°C'},
        'sensors': {name: _sensor_document(name, m) for name, m in model.sensors.items()},
        'provenance': {
            'sources': dict(model.provenance.sources),
            'version': model.provenance.version,
            'notes': list(model.provenance.notes),
        },
        'history': [model_document(earlier) for earlier in model.history],
    }


def _sensor_document(name: str, model: SensorModel) -> dict[str, Any]:
    unit = SENSOR_UNITS[name]
    if model.noise is None:
        raise ModelError(f'sensors.{name}.noise: missing; a fitted model has it')
    return {
        'unit': unit,
        'temperature_range': {'value': [*map(float, model.temperature_range)], 'unit': '°C'},
        'effects': [
            {
                'name': effect.name,
                'shape': _shape_document(effect, model.shape_std),
                'units': [text.replace('{unit}', unit) for text in effect.coefficient_units],
                'coefficients': coefficients.tolist(),
                'rms': np.asarray(model.contributions.get(effect.name, np.zeros(3))).tolist(),
            }
            for effect, coefficients in zip(model.effects, model.coefficients, strict=True)
        ],
        'covariance': model.covariance.tolist(),
        'levels': {run: np.asarray(level).tolist() for run, level in model.levels.items()},
        'noise': {
            'white': {'value': model.noise.white.tolist(), 'unit': f'{unit}·√s'},
            'time_constants': {'value': model.noise.time_constants.tolist(), 'unit': 's'},
            'amplitudes': {'value': model.noise.amplitudes.tolist(), 'unit': unit},
        },
    }


def _shape_document(effect: Effect, std: Mapping[str, tuple[float, ...]]) -> dict[str, Any]:
    shape: dict[str, Any] = {}
    for item in fields(effect):
        value = getattr(effect, item.name)
        shape[item.name] = {
            'value': [*map(float, value)] if isinstance(value, tuple) else float(value),
            'unit': item.metadata.get('unit', ''),
        }
        if (found := std.get(f'{effect.name}.{item.name}')) is not None:
            shape[item.name]['std'] = [*map(float, found)]
    return shape


def model_from_document(
    document: Any, effects: Mapping[str, type[Effect]] = EFFECTS
) -> ThermalModel:
    """Return the model of a document, checked field by field."""
    root = Field(document)
    schema = root['schema']
    if schema.value != SCHEMA:
        raise schema.refuse(f'is {schema.value!r}, this version reads {SCHEMA}')
    unknown = sorted(set(root.entries()) - set(ROOT_FIELDS))
    if unknown:
        raise root[unknown[0]].refuse(f'no such field; there are {", ".join(ROOT_FIELDS)}')
    reference = root['reference_temperature']
    _check_unit(reference, '°C')
    sensors: dict[str, SensorModel] = {}
    for name, entry in root['sensors'].entries().items():
        if name not in SENSOR_UNITS:
            raise entry.refuse(f'no such sensor; there are {", ".join(SENSORS)}')
        sensors[name] = _sensor(entry, SENSORS[SENSORS.index(name)], effects)
    if not sensors:
        raise root['sensors'].refuse('holds no sensor')
    provenance = root['provenance']
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
    _check_unit(entry, unit)
    found: list[Effect] = []
    coefficients: list[FloatArray] = []
    std: dict[str, tuple[float, ...]] = {}
    rms: dict[str, FloatArray] = {}
    for item in entry['effects'].items():
        effect = _effect(item, catalogue, std)
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
    for key, expected in (('white', f'{unit}·√s'), ('time_constants', 's'), ('amplitudes', unit)):
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
    _check_unit(entry, '°C')
    low, high = entry['value'].array(2)
    if low > high:
        raise entry.refuse(f'is {low:g} … {high:g}: the lower end comes first')
    return float(low), float(high)


def _check_unit(entry: Field, unit: str) -> None:
    found = entry['unit']
    if found.value != unit:
        raise found.refuse(f'is {found.value!r}, expected {unit!r}')


class _Loader(getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):  # type: ignore[misc]
    """The safe loader, in C where there is one."""


class _Dumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """The safe dumper without anchors."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 (the dumper's signature)
        """Write equal values out each time."""
        return True
