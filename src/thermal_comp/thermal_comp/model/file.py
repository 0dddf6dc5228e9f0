# SPDX-License-Identifier: Apache-2.0
"""Thermal models as YAML: every number exact, every field checked on the way in."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from imu_recording.recording import SENSOR_UNITS

from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.model.document import SCHEMA, Field, model_from_document
from thermal_comp.model.values import ModelError, SensorModel, ThermalModel

__all__ = ['check_device', 'load_model', 'model_document', 'save_model']


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
        document = _parsed(Path(path).read_text('utf-8'))
    except OSError as error:
        raise ModelError(f'{path}: {error.strerror}') from None
    except ModelError as error:
        raise ModelError(f'{path}: {error}') from None
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


def _parsed(text: str) -> Any:
    """Return the document; refuse a key that stands twice, of which YAML takes the last."""
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _refuse_repeated(node, '', set())
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _refuse_repeated(node: yaml.Node, name: str, visited: set[int]) -> None:
    if id(node) in visited:  # an alias
        return
    visited.add(id(node))
    if isinstance(node, yaml.SequenceNode):
        for i, item in enumerate(node.value):
            _refuse_repeated(item, f'{name}[{i}]', visited)
    elif isinstance(node, yaml.MappingNode):
        seen = set()
        for key, value in node.value:
            own = f'{name}.{key.value}' if name else str(key.value)
            if own in seen:
                line = key.start_mark.line + 1
                raise Field(None, own).refuse(f'is there twice, again in line {line}')
            seen.add(own)
            _refuse_repeated(value, own, visited)


class _Loader(getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):  # type: ignore[misc]
    """The safe loader, in C where there is one."""


class _Dumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """The safe dumper without anchors."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 (the dumper's signature)
        """Write equal values out each time."""
        return True
