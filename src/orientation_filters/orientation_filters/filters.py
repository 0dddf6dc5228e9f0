# SPDX-License-Identifier: Apache-2.0
"""The catalogue of filters and their presets, and one call that runs a filter over a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from types import ModuleType
from typing import Any

import numpy as np
from imu_recording.recording import ImuRecording
from imu_recording.ros.parameter import ParameterError, checked, default_of
from imu_recording.user_error import UserError

from orientation_filters.ahrs import filter as ahrs
from orientation_filters.ahrs.parameters import AhrsParameters
from orientation_filters.complementary import filter as complementary
from orientation_filters.complementary.parameters import ComplementaryParameters
from orientation_filters.parameters import FilterParameters, check_mount
from orientation_filters.result import OrientationResult
from orientation_filters.rotation.arrays import rotate

FILTERS: dict[str, ModuleType] = {'complementary': complementary, 'ahrs': ahrs}
"""Name → module with Params, State, initial_state, update, run."""

PARAMETERS: dict[str, type[FilterParameters]] = {
    'complementary': ComplementaryParameters,
    'ahrs': AhrsParameters,
}
"""Name → dataclass of the filter's named parameters, with its presets."""


class FilterError(UserError):
    """A recording and a filter that do not go together; the message names both."""


def filter_parameters(name: str, **values: Any) -> FilterParameters:
    """Return the named parameters of a filter: the preset's values, then the given ones, checked.

    >>> filter_parameters('complementary', preset='robust').cutoff_hz
    0.03
    >>> filter_parameters('complementary', preset='robust', cutoff_hz=5).cutoff_hz
    5.0
    """
    if name not in FILTERS:
        raise FilterError(f'no filter {name!r}; there are {", ".join(FILTERS)}')
    defaults = PARAMETERS[name]()
    items = {item.name: item for item in fields(defaults)}
    unknown = sorted(set(values) - set(items))
    if unknown:
        raise ParameterError(
            f'unknown parameter {unknown[0]}; {name} has {", ".join(sorted(items))}'
        )
    preset = checked(items['preset'], values.get('preset', defaults.preset))
    chosen = {**defaults.presets[preset], **values, 'preset': preset}
    parameters = replace(defaults, **{k: checked(items[k], v) for k, v in chosen.items()})
    check_mount(parameters)
    return parameters


def preset_changes(
    filter_name: str, before: str, after: str, values: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the values a change of preset sets; what was set by hand stays.

    >>> preset_changes('ahrs', 'paper', 'robust', {'adaptive': False})
    {'adaptive': True}
    """
    kind = PARAMETERS[filter_name]
    if after not in kind.presets:
        return {}
    old, new = kind.presets[before], kind.presets[after]
    defaults = {item.name: default_of(item) for item in fields(kind)}
    return {
        name: new.get(name, defaults[name])
        for name in old.keys() | new.keys()
        if values[name] == old.get(name, defaults[name])
    }


def run_filter(
    name: str, recording: ImuRecording, *, details: bool = False, **values: Any
) -> OrientationResult:
    """Run a filter over a recording: preset='paper' | 'robust', cutoff_hz=…, world_frame=….

    Returns the attitude of the body (the sensor's where no `mount` is given) in the world, and
    with `details` the filter's other states. A cut-off above half the sample rate is refused.
    """
    parameters = filter_parameters(name, **values)
    check_cutoff(parameters, sample_rate(recording))
    mounted = mount(recording, parameters)
    run = module(name, parameters).run
    result: OrientationResult = run(mounted, parameters.kernel_params(), details=details)
    return result


def module(name: str, parameters: FilterParameters) -> ModuleType:
    """Return the module that runs a filter: the compiled one, or the one on filterpy."""
    if getattr(parameters, 'implementation', 'native') == 'filterpy':
        try:
            from orientation_filters.ahrs import filterpy_kalman
        except ImportError as error:
            raise FilterError(
                f'implementation filterpy needs filterpy (pip install filterpy): {error}'
            ) from error
        return filterpy_kalman
    return FILTERS[name]


def state_bytes(name: str, preset: str = 'paper') -> int:
    """Return the memory of a filter's state: eight bytes per number that the preset uses."""
    filter_module = FILTERS[name]
    kind = 'ADAPTIVE_STATE' if preset == 'paper' else 'FIXED_STATE'
    unused = getattr(filter_module, kind, ())
    state = filter_module.initial_state()._asdict()
    return 8 * sum(_numbers(value) for field, value in state.items() if field not in unused)


def _numbers(value: Any) -> int:
    return sum(map(_numbers, value)) if isinstance(value, tuple) else 1


def sample_rate(recording: ImuRecording) -> float:
    """Return the median sample rate [Hz]; NaN for fewer than two samples."""
    if len(recording) < 2:
        return float('nan')
    return 1e9 / float(np.median(np.diff(recording.stamp)))


def check_cutoff(parameters: FilterParameters, rate_hz: float) -> None:
    """Refuse a cut-off above half the sample rate, naming both."""
    for name in ('cutoff_hz', 'heading_cutoff_hz'):
        cutoff = getattr(parameters, name, 0.0)
        if cutoff > 0.5 * rate_hz:
            raise FilterError(
                f'{name} {cutoff:g} Hz is above half the sample rate of {rate_hz:.4g} Hz: lower '
                f'it to at most {0.5 * rate_hz:.4g} Hz or interpolate the recording'
            )


def mount(recording: ImuRecording, parameters: FilterParameters) -> ImuRecording:
    """Return the recording in the axes of the body."""
    q = np.array(parameters.mount)
    if np.array_equal(q, [0.0, 0.0, 0.0, 1.0]):
        return recording
    q = q / np.linalg.norm(q)
    return replace(
        recording,
        angular_velocity=rotate(q, recording.angular_velocity),
        linear_acceleration=rotate(q, recording.linear_acceleration),
        magnetic_field=rotate(q, recording.magnetic_field),
    )
