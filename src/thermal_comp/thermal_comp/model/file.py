# SPDX-License-Identifier: Apache-2.0
"""Thermal models as YAML: every number exact, every field checked on the way in."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml
from imu_recording.deep_yaml import YAML_LOADER, refuse_deep_yaml
from imu_recording.user_error import fault_in_yaml

from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.model.document import Field, model_from_document
from thermal_comp.model.values import ModelError, ThermalModel


def save_model(model: ThermalModel, path: str | os.PathLike[str]) -> None:
    """Write the model as YAML; reading it back gives the same numbers, bit for bit.

    Raises ModelError where it could not be read back: its numbers are none a sensor has.
    """
    catalogue = {effect.name: type(effect) for m in _versions(model) for effect in _effects_of(m)}
    try:
        model_from_document(model.to_dict(), catalogue)
    except ModelError as error:
        raise ModelError(f'the model is not saved: {error}') from None
    Path(path).write_text(_text(model), 'utf-8')


def model_label(model: ThermalModel) -> str:
    """Return device and hash of a model, by which compensated data name what was subtracted.

    The hash is the SHA-256 of the text `save_model` writes, in 16 hexadecimal digits.
    """
    digest = hashlib.sha256(_text(model).encode()).hexdigest()[:16]
    return f'model of {model.device or "a device without name"}, sha256 {digest}'


def _versions(model: ThermalModel) -> Iterator[ThermalModel]:
    yield model
    for earlier in model.history:
        yield from _versions(earlier)


def _effects_of(model: ThermalModel) -> Iterator[Effect]:
    for sensor in model.sensors.values():
        yield from sensor.effects


def _text(model: ThermalModel) -> str:
    return yaml.dump(
        model.to_dict(),
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        default_flow_style=None,
        width=110,
    )


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
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ModelError(f'{path}: not a YAML file: {fault_in_yaml(error)}') from None
    try:
        return model_from_document(document, effects)
    except ModelError as error:
        raise ModelError(f'{path}: {error}') from None


def check_device(model: ThermalModel | None, device: str) -> None:
    """Refuse a recording of another device; one whose device is not named passes.

    Case is ignored: boards have their names in capitals, files seldom do.
    """
    if model is None:
        return
    known = model.device.split('+') if model.pooled else [model.device]
    if device and model.device and device.casefold() not in map(str.casefold, known):
        raise ModelError(
            f'device: the model is of {model.device}, the data of {device}; '
            'fit a model of that device, or of several together (fit --pooled)'
        )


def _parsed(text: str) -> Any:
    """Return the document; refuse a key that occurs twice, of which YAML takes the last."""
    refuse_deep_yaml(text)
    loader = YAML_LOADER(text)
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


class _Dumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """The safe dumper without anchors."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 (the dumper's signature)
        """Write equal values out each time."""
        return True
