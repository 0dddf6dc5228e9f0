# SPDX-License-Identifier: Apache-2.0
"""Named sets of parameter values, and parameters made from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, TypeVar

from imu_recording.parameter import ParameterError, checked, default_of

from orientation_filters.ahrs_parameters import AhrsParameters
from orientation_filters.complementary_parameters import ComplementaryParameters
from orientation_filters.parameters import FilterParameters, check_mount

P = TypeVar('P', bound=FilterParameters)

PARAMETERS: dict[str, type[FilterParameters]] = {
    'complementary': ComplementaryParameters,
    'ahrs': AhrsParameters,
}
"""Filter → the dataclass of its named parameters."""

PRESETS: dict[str, dict[str, dict[str, Any]]] = {
    'complementary': {
        'paper': {},
        'robust': {
            'adaptive': True,
            'learn_bias': True,
            'cutoff_hz': 0.03,
            'heading_cutoff_hz': 0.015,
            'integral_gain': 0.0,
        },
    },
    'ahrs': {'paper': {}, 'robust': {'adaptive': True}},
}
"""What each preset sets beside the defaults, per filter."""


def with_preset(parameters: P, filter_name: str, **values: Any) -> P:
    """Return the parameters with the preset's values, then the given ones, checked.

    >>> with_preset(ComplementaryParameters(), 'complementary', cutoff_hz=5).cutoff_hz
    5.0
    """
    items = {item.name: item for item in fields(parameters)}
    unknown = sorted(set(values) - set(items))
    if unknown:
        raise ParameterError(
            f'unknown parameter {unknown[0]}; {filter_name} has {", ".join(sorted(items))}'
        )
    preset = checked(items['preset'], values.get('preset', parameters.preset))
    chosen = {**PRESETS[filter_name][preset], **values, 'preset': preset}
    made = replace(parameters, **{k: checked(items[k], v) for k, v in chosen.items()})
    check_mount(made)
    return made


def preset_changes(
    parameters_class: type[FilterParameters],
    before: Mapping[str, Any],
    preset: Mapping[str, Any],
    values: Mapping[str, Any],
) -> dict[str, Any]:
    """Return what a preset after another one sets, where nobody has set a value by hand."""
    defaults = {item.name: default_of(item) for item in fields(parameters_class)}
    return {
        name: preset.get(name, defaults[name])
        for name in before.keys() | preset.keys()
        if values[name] == before.get(name, defaults[name])
    }
