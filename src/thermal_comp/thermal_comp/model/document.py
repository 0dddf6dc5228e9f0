# SPDX-License-Identifier: Apache-2.0
"""A thermal model from plain mappings, lists and numbers, every field checked on the way in."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_UNITS, FloatArray
from imu_recording.user_error import did_you_mean

from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect, shape_bounds
from thermal_comp.effects.user_effects import source_of
from thermal_comp.model.bounds import (
    impossible_sizes,
    impossible_terms,
    outside_temperatures,
    typical_conditions,
)
from thermal_comp.model.values import (
    SCHEMA,
    VIBRATION_UNIT,
    ModelError,
    NoiseModel,
    Provenance,
    SensorModel,
    ThermalModel,
)


class Field:
    """One value of a document and its dotted name.

    >>> Field({'a': {'b': [1, 'x']}})['a']['b'].array()
    Traceback (most recent call last):
    thermal_comp.model.values.ModelError: a.b: 'x' is no number
    """

    def __init__(self, value: Any, name: str = '') -> None:
        self.value = value
        self.name = name

    def refuse(self, reason: str) -> ModelError:
        """Return the error that names this field."""
        return ModelError(f'{self.name or "document"}: {reason}')

    def __getitem__(self, key: str) -> Field:
        """Return an entry that has to be there."""
        name = f'{self.name}.{key}' if self.name else key
        if key not in self.mapping():
            raise ModelError(f'{name}: missing')
        return Field(self.value[key], name)

    def get(self, key: str, default: Any) -> Field:
        """Return an entry that may be absent."""
        name = f'{self.name}.{key}' if self.name else key
        return Field(self.mapping().get(key, default), name)

    def mapping(self) -> Mapping[str, Any]:
        """Return the value as a mapping."""
        if not isinstance(self.value, Mapping):
            raise self.refuse(f'is {_shown(self.value)}, expected a mapping')
        return self.value

    def only(self, *names: str) -> None:
        """Refuse an entry of another name: a misspelt field would be ignored."""
        unknown = [key for key in self.mapping() if key not in names]
        if unknown:
            entry = Field(None, f'{self.name}.{unknown[0]}' if self.name else str(unknown[0]))
            raise entry.refuse(f'no such field; there are {", ".join(names)}')

    def entries(self) -> dict[str, Field]:
        """Return the entries of a mapping by key."""
        return {str(key): self[key] for key in self.mapping()}

    def items(self) -> list[Field]:
        """Return the items of a list."""
        if not isinstance(self.value, list):
            raise self.refuse(f'is {_shown(self.value)}, expected a list')
        return [Field(item, f'{self.name}[{i}]') for i, item in enumerate(self.value)]

    def text(self) -> str:
        """Return the value as text."""
        if not isinstance(self.value, str):
            raise self.refuse(f'is {_shown(self.value)}, expected text')
        return self.value

    def flag(self) -> bool:
        """Return the value as true or false."""
        if not isinstance(self.value, bool):
            raise self.refuse(f'is {_shown(self.value)}, expected true or false')
        return self.value

    def number(self) -> float:
        """Return the value as a finite number; text such as 1e-5, which YAML leaves, counts."""
        value = self.value
        try:
            if isinstance(value, bool | None | list | Mapping):
                raise ValueError
            number = float(value)
        except ValueError:
            raise self.refuse(f'{_shown(value)} is no number') from None
        if not math.isfinite(number):
            raise self.refuse(f'is {number}, expected a finite number')
        return number

    def array(self, *shape: int | None) -> FloatArray:
        """Return nested lists as an array; None in `shape` stands for any length."""
        array = np.array(self._numbers(self.value))
        fits = array.ndim == len(shape) and all(
            w is None or w == n for w, n in zip(shape, array.shape, strict=True)
        )
        if shape and not fits:
            wanted = ' × '.join('any' if n is None else str(n) for n in shape)
            raise self.refuse(f'has shape {array.shape}, expected {wanted}')
        return array

    def _numbers(self, value: Any) -> Any:
        if not isinstance(value, list):
            return Field(value, self.name).number()
        rows = [self._numbers(item) for item in value]
        if len({np.shape(row) for row in rows}) > 1:
            raise self.refuse('has rows of different lengths')
        return rows


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 40 else f'{text[:37]}…'


ROOT_FIELDS = (
    'schema',
    'device',
    'pooled',
    'reference_temperature',
    'sensors',
    'provenance',
    'history',
)
Stds = dict[str, dict[str, tuple[float, ...]]]
"""By field of a shape parameter: its standard deviations by `effect.parameter`."""
SENSOR_FIELDS = ('unit', 'temperature_range', 'effects', 'covariance', 'levels', 'noise')
EFFECT_FIELDS = ('name', 'source', 'shape', 'units', 'coefficients', 'rms')


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
    reference_temperature = reference['value'].number()
    _refuse(reference['value'], outside_temperatures(reference_temperature))
    sensors: dict[str, SensorModel] = {}
    for name, entry in root['sensors'].entries().items():
        if name not in SENSOR_UNITS:
            raise entry.refuse(f'no such sensor; there are {", ".join(SENSORS)}')
        sensors[name] = _sensor(
            entry, SENSORS[SENSORS.index(name)], effects, reference_temperature
        )
    if not sensors:
        raise root['sensors'].refuse('holds no sensor')
    provenance = root['provenance']
    provenance.only('sources', 'version', 'notes')
    sources = provenance['sources'].entries()
    return ThermalModel(
        device=root['device'].text(),
        sensors=sensors,
        reference_temperature=reference_temperature,
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


def _sensor(
    entry: Field,
    sensor: Sensor,
    catalogue: Mapping[str, type[Effect]],
    reference_temperature: float,
) -> SensorModel:
    unit = SENSOR_UNITS[sensor]
    entry.only(*SENSOR_FIELDS)
    _check_unit(entry, unit)
    found: list[Effect] = []
    coefficients: list[FloatArray] = []
    std: Stds = {'std': {}, 'form_std': {}}
    rms: dict[str, FloatArray] = {}
    for item in entry['effects'].items():
        effect = _effect(item, catalogue, std)
        if effect.name in rms:
            raise item['name'].refuse(f'{effect.name!r} is there twice')
        found.append(effect)
        rms[effect.name] = item.get('rms', [0.0, 0.0, 0.0]).array(3)
        _refuse(item.get('rms', None), impossible_sizes(sensor, rms[effect.name]))
        coefficients.append(_coefficients(item['coefficients'], effect, sensor))
    covariance = _covariance(entry['covariance'], sum(c.size for c in coefficients))
    low, high = _range(entry['temperature_range'])
    # Fitted far from the reference, a line is large there: what the levels hold is no error.
    reference = min(max(reference_temperature, low), high)
    conditions = typical_conditions(low, high, reference, sensor)
    terms = list(zip(found, coefficients, _blocks(covariance, coefficients), strict=True))
    for number, field, reason in impossible_terms(terms, conditions):
        owner = entry if field == 'covariance' else entry['effects'].items()[number]
        raise owner[field].refuse(reason)
    return SensorModel(
        effects=tuple(found),
        coefficients=tuple(coefficients),
        covariance=covariance,
        noise=_noise(entry['noise'], sensor),
        levels={run: level.array(3) for run, level in entry.get('levels', {}).entries().items()},
        shape_std=std['std'],
        shape_form_std=std['form_std'],
        contributions=rms,
        temperature_range=(low, high),
    )


def _refuse(place: Field, reason: str) -> None:
    """Raise the error of a field where there is a reason."""
    if reason:
        raise place.refuse(reason)


def _blocks(covariance: FloatArray, coefficients: Sequence[FloatArray]) -> Iterator[FloatArray]:
    """Give the covariance of each effect's coefficients."""
    start = 0
    for each in coefficients:
        part = slice(start, start + each.size)
        yield covariance[part, part]
        start += each.size


def _effect(item: Field, catalogue: Mapping[str, type[Effect]], std: Stds) -> Effect:
    item.only(*EFFECT_FIELDS)
    name = item['name'].text()
    if name not in catalogue:
        raise item['name'].refuse(
            f'{name!r} is not in the catalogue{did_you_mean(name, catalogue)}; if it is an '
            f'effect of your own, give its file {_told_file(item)}with --effects (a node: '
            'parameter effects)'
        )
    _check_source(item, catalogue[name])
    known = {f.name: f for f in fields(catalogue[name])}
    shape: dict[str, Any] = {}
    for key, entry in item.get('shape', {}).entries().items():
        if key not in known:
            raise entry.refuse(f'{name} has no such parameter; it has {", ".join(known)}')
        entry.only('value', 'unit', *std)
        _check_unit(entry, known[key].metadata.get('unit', ''))
        values = entry['value'].array()
        low, high = shape_bounds(known[key])
        # The ends of the range may be off by a rounding of the search scale.
        slack = 1e-9 * max(abs(low), abs(high)) if np.isfinite([low, high]).all() else 0.0
        if not ((low - slack <= values) & (values <= high + slack)).all():
            raise entry['value'].refuse(f'is {entry["value"].value}, expected {low:g} … {high:g}')
        shape[key] = tuple(values.tolist()) if values.ndim else float(values)
        for kind in std:
            if kind in entry.mapping():
                std[kind][f'{name}.{key}'] = tuple(entry[kind].array(None).tolist())
    for key, parameter in known.items():
        # A default of zero says that what the parameter describes is absent.
        needed = np.any(np.array(parameter.default)) and not parameter.metadata.get('assumed')
        if key not in shape and needed:
            raise ModelError(f'{item.name}.shape.{key}: missing')
    return catalogue[name](**shape)


def _told_file(item: Field) -> str:
    source = item.get('source', None)
    return f'{source["module"].text()} ' if source.value is not None else ''


def _check_source(item: Field, effect: type[Effect]) -> None:
    """Refuse an effect of the user's own whose code is another than the model was fitted with."""
    fitted = item.get('source', None)
    if fitted.value is None:
        return
    fitted.only('module', 'sha256')
    wanted, found = fitted['sha256'].text(), (source_of(effect) or {}).get('sha256', '')
    if found != wanted:
        raise fitted['sha256'].refuse(
            f'the model was fitted with another version of {fitted["module"].text()} '
            f'({wanted}; here {found or "the catalogue"}): fit it again'
        )


def _coefficients(entry: Field, effect: Effect, sensor: Sensor) -> FloatArray:
    """Return the coefficients, of the shape the effect's own columns ask for."""
    width, shared = _columns_of(effect, sensor)
    shape: tuple[int | None, ...] = (width,) if shared else (width, 3)
    if not shape[0] and entry.value == []:
        return np.zeros((0, 3))
    return entry.array(*((None, *shape) if effect.per_run else shape))


def _columns_of(effect: Effect, sensor: Sensor) -> tuple[int, bool]:
    """Return number of columns and whether the axes share them, tried on a typical cycle."""
    columns = effect.columns(typical_conditions(0.0, 40.0, 20.0, sensor))[0]
    return columns.shape[-1], columns.ndim == 3


def _covariance(entry: Field, size: int) -> FloatArray:
    if not size:
        return np.zeros((0, 0))
    covariance = entry.array(size, size)
    root = np.sqrt(np.abs(np.diag(covariance)))
    scale = np.outer(root, root)
    if (np.abs(covariance - covariance.T) > 1e-9 * scale).any():
        raise entry.refuse('is not symmetric')
    if (np.diag(covariance) < 0.0).any():
        raise entry.refuse('has a negative variance')
    return covariance


def _noise(entry: Field, sensor: Sensor) -> NoiseModel:
    unit = SENSOR_UNITS[sensor]
    units = {'white': f'{unit}·√s', 'time_constants': 's', 'amplitudes': unit}
    shaken = {'per_vibration': f'({unit})²·s/(m/s²)²', 'still_vibration': VIBRATION_UNIT}
    entry.only(*units, *shaken, 'white_weights')
    grows = any(key in entry.mapping() for key in shaken)
    for key, expected in {**units, **(shaken if grows else {})}.items():
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
        _refuse(entry[key]['value'], impossible_sizes(sensor, values))
    axes = entry.get('white_weights', [False, False, False])
    on = tuple(item.flag() for item in axes.items())
    if len(on) != 3:
        raise axes.refuse(f'has {len(on)} items, expected one per axis')
    noise = NoiseModel(white, times, amplitudes, white_weights=on)
    if not grows:
        return noise
    density = entry['per_vibration']['value'].array(3)
    still = entry['still_vibration']['value'].number()
    if (density < 0.0).any() or still < 0.0:
        raise entry['per_vibration'].refuse('or still_vibration is a negative variance')
    return replace(noise, per_vibration=density, still_vibration=still)


def _range(entry: Field) -> tuple[float, float]:
    entry.only('value', 'unit')
    _check_unit(entry, '°C')
    low, high = entry['value'].array(2)
    if low > high:
        raise entry.refuse(f'is {low:g} … {high:g}: the lower end comes first')
    _refuse(entry['value'], outside_temperatures(low, high))
    return float(low), float(high)


def _check_unit(entry: Field, unit: str) -> None:
    found = entry['unit']
    if found.value != unit:
        raise found.refuse(f'is {found.value!r}, expected {unit!r}')
