# SPDX-License-Identifier: Apache-2.0
"""Node parameters as fields of a frozen dataclass: default, meaning, unit, range, choices.

>>> from dataclasses import dataclass
>>> @dataclass(frozen=True)
... class Config:
...     cutoff_hz: float = parameter(3.0, 'Cut-off frequency', unit='Hz', bounds=(0.01, 100.0))
>>> config_from_values(Config, {'cutoff_hz': 4})
Config(cutoff_hz=4.0)
>>> try:
...     config_from_values(Config, {'cutoff_hz': 400})
... except ParameterError as error:
...     print(error)
cutoff_hz is 400, expected 0.01 … 100 Hz
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from difflib import get_close_matches
from typing import Any, TypeVar

from imu_recording.user_error import UserError

C = TypeVar('C')

TYPE_NAMES = {
    bool: 'true or false',
    int: 'a whole number',
    float: 'a number',
    str: 'a text; digits alone are one in double quotes: "\'123\'"',
    list: 'a list such as [a, b]',
}
"""Name of each type in messages to the user."""

ROS_PARAMETERS = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')
"""Parameters that ROS gives every node, or the beginnings of their names."""


class ParameterError(UserError):
    """A parameter's value cannot be used; the message names it and what is expected."""


def parameter(
    default: Any,
    description: str,
    *,
    unit: str = '',
    bounds: tuple[float, float] | None = None,
    choices: tuple[str, ...] = (),
    dynamic: bool = False,
) -> Any:
    """Declare a dataclass field as a node parameter.

    `bounds` are inclusive; `dynamic` parameters may be set while the node is active. The type of
    the parameter is the type of its default; numeric parameters accept integers.
    """
    metadata = {
        'description': description,
        'unit': unit,
        'bounds': bounds,
        'choices': choices,
        'dynamic': dynamic,
    }
    if isinstance(default, list):
        return field(default_factory=lambda: list(default), metadata=metadata)
    return field(default=default, metadata=metadata)


def default_of(item: Field[Any]) -> Any:
    """Return the default value of a field declared by `parameter`."""
    if item.default is not MISSING:
        return item.default
    assert item.default_factory is not MISSING  # noqa: S101 (parameter() always gives a default)
    return item.default_factory()


def config_from_values(config_class: type[C], values: Mapping[str, Any]) -> C:
    """Return a `config_class` of the values, checked; raise ParameterError naming what is wrong.

    Parameters that are missing take their defaults; unknown names are refused.
    """
    items = {item.name: item for item in fields(config_class)}  # type: ignore[arg-type]
    unknown = sorted(set(values) - set(items))
    if unknown:
        raise ParameterError(f'unknown parameter {unknown[0]}; known: {", ".join(sorted(items))}')
    return config_class(**{name: checked(items[name], value) for name, value in values.items()})


def unknown_parameters(given: Iterable[str], known: Collection[str]) -> list[str]:
    """Return a note for each given name that a node does not have, with what may be meant.

    >>> unknown_parameters(['cutof_hz', 'use_sim_time'], ['cutoff_hz', 'preset'])
    ["parameter 'cutof_hz' is unknown and ignored; is 'cutoff_hz' meant?"]
    """
    notes = []
    for name in sorted(given):
        if name in known or name.startswith(ROS_PARAMETERS):
            continue
        near = get_close_matches(name, known, 1)
        way = f"; is '{near[0]}' meant?" if near else '; --help lists those there are'
        notes.append(f'parameter {name!r} is unknown and ignored{way}')
    return notes


def listed(choices: Iterable[str]) -> str:
    """Return choices in a row, an empty one visible."""
    return ', '.join(choice or "''" for choice in choices)


def checked(item: Field[Any], value: Any) -> Any:
    """Return the value as the type of the field's default; raise ParameterError if it is not."""
    value = converted(item, value)
    bounds = item.metadata['bounds']
    if bounds is not None:
        numbers = value if isinstance(value, list) else [value]
        for number in numbers:
            if not (math.isfinite(number) and bounds[0] <= number <= bounds[1]):
                unit = f' {item.metadata["unit"]}' if item.metadata['unit'] else ''
                raise ParameterError(
                    f'{item.name} is {number:g}, expected {bounds[0]:g} … {bounds[1]:g}{unit}'
                )
    choices = item.metadata['choices']
    if choices and value not in choices:
        raise ParameterError(f'{item.name} is {value!r}, expected one of {listed(choices)}')
    return value


def converted(item: Field[Any], value: Any) -> Any:
    """Return the value as the type of the field's default; ParameterError where it has none."""
    return _converted(item.name, default_of(item), value)


def _converted(name: str, default: Any, value: Any) -> Any:
    if isinstance(default, list) and value is None:  # how ROS hands over []
        return []
    if isinstance(default, list) and hasattr(value, '__iter__') and not isinstance(value, str):
        return [_converted(name, default[0] if default else '', v) for v in value]
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if isinstance(default, bool) or not isinstance(default, int | float):
        if isinstance(value, type(default)):
            return value
    elif is_number and (isinstance(default, float) or float(value).is_integer()):
        return type(default)(value)
    raise ParameterError(f'{name} is {value!r}, expected {TYPE_NAMES[type(default)]}')


@dataclass(frozen=True)
class NodeConfig:
    """Parameters all nodes have; each node's dataclass extends this one."""

    autostart: bool = parameter(True, 'Configure and activate by itself at start')
    qos_depth: int = parameter(500, 'Queue depth of publishers and subscriptions', bounds=(1, 1e5))
