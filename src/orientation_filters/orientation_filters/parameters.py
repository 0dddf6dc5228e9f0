# SPDX-License-Identifier: Apache-2.0
"""Named parameters of the filters: unit, range, meaning, presets, and what kernels make of them.

The defaults are the preset `paper`; `PRESETS` names what the others change.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import cos, isclose, pi, sin
from typing import Any, TypeVar

from imu_recording.parameter import ParameterError, checked, parameter

from orientation_filters import ahrs_kalman, complementary
from orientation_filters.ahrs_adaptive import AdaptiveParams
from orientation_filters.ahrs_correction import Noise
from orientation_filters.magnetic_reference import FieldParams
from orientation_filters.rest import RestParams

WORLD_FRAMES = ('enu', 'ned')
PRESET_NAMES = ('paper', 'robust')
P = TypeVar('P', bound='FilterParameters')


@dataclass(frozen=True)
class FilterParameters:
    """Parameters both filters have."""

    preset: str = parameter(
        'paper', 'Values of all that is not set: as the paper, or robust', choices=PRESET_NAMES
    )
    world_frame: str = parameter('enu', 'Axes of the world', choices=WORLD_FRAMES)
    use_magnetometer: bool = parameter(True, 'Nine axes; false: heading from the gyroscope alone')
    magnetic_declination: float = parameter(
        0.0, 'Of magnetic north from true north, east positive', unit='rad', bounds=(-pi, pi)
    )
    mount: list[float] = parameter(  # noqa: RUF009 (a default factory underneath)
        [0.0, 0.0, 0.0, 1.0], 'Rotation sensor → body, quaternion xyzw', bounds=(-1.0, 1.0)
    )
    max_gap: float = parameter(
        1.0, 'Longer pauses set the attitude anew', unit='s', bounds=(1e-3, 3600.0)
    )
    magnetometer_timeout: float = parameter(
        0.5, 'How long a magnetometer sample holds', unit='s', bounds=(1e-3, 3600.0)
    )
    adaptive: bool = parameter(
        False, 'Adapt to acceleration, rest and magnetic disturbance', dynamic=True
    )
    learn_bias: bool = parameter(True, 'Learn the gyroscope bias', dynamic=True)
    rest_angular_velocity: float = parameter(
        0.035, 'At rest: largest rms change', unit='rad/s', bounds=(0.0, 10.0), dynamic=True
    )
    rest_linear_acceleration: float = parameter(
        0.3, 'At rest: largest rms change', unit='m/s²', bounds=(0.0, 100.0), dynamic=True
    )
    rest_duration: float = parameter(
        1.5, 'At rest: for at least', unit='s', bounds=(0.0, 3600.0), dynamic=True
    )
    bias_limit: float = parameter(
        0.2,
        'Larger rates are not taken for a bias',
        unit='rad/s',
        bounds=(0.0, 10.0),
        dynamic=True,
    )
    field_tolerance: float = parameter(
        0.14,
        'Disturbed: distance from the reference as part of its norm',
        bounds=(0.0, 10.0),
        dynamic=True,
    )
    field_adoption: float = parameter(
        20.0,
        'A steady new field becomes the reference after',
        unit='s',
        bounds=(0.0, 1e6),
        dynamic=True,
    )

    def kernel_params(self) -> Any:
        """Return what the filter's kernel needs."""
        raise NotImplementedError


@dataclass(frozen=True)
class ComplementaryParameters(FilterParameters):
    """Parameters of the complementary filter."""

    cutoff_hz: float = parameter(
        3.0,
        'Cut-off between gyroscope and accelerometer',
        unit='Hz',
        bounds=(1e-4, 1e3),
        dynamic=True,
    )
    heading_cutoff_hz: float = parameter(
        0.0,
        'Cut-off between gyroscope and magnetometer; 0: as cutoff_hz',
        unit='Hz',
        bounds=(0.0, 1e3),
        dynamic=True,
    )
    integral_gain: float = parameter(
        0.1, 'Of bias learning in motion, part of cut-off²', bounds=(0.0, 10.0), dynamic=True
    )
    rest_bias_time: float = parameter(
        2.0,
        'Time constant of bias learning at rest',
        unit='s',
        bounds=(0.01, 3600.0),
        dynamic=True,
    )
    angle_random_walk: float = parameter(
        2e-4,
        'Of the gyroscope, for the covariance',
        unit='rad/√s',
        bounds=(0.0, 1.0),
        dynamic=True,
    )
    bias_sigma: float = parameter(
        5e-3, 'Bias left over, for the covariance', unit='rad/s', bounds=(0.0, 1.0), dynamic=True
    )
    inclination_sigma: float = parameter(
        0.02,
        'Error of a specific force as a vertical, for the covariance',
        unit='rad',
        bounds=(0.0, pi),
        dynamic=True,
    )
    heading_sigma: float = parameter(
        0.05,
        'Error of a field as a heading, for the covariance',
        unit='rad',
        bounds=(0.0, pi),
        dynamic=True,
    )

    def kernel_params(self) -> complementary.Params:
        """Return what the kernel needs."""
        up, north = world_axes(self.world_frame, self.magnetic_declination)
        rate = 2.0 * pi * self.cutoff_hz
        return complementary.Params(
            up,
            north,
            self.use_magnetometer,
            rate,
            2.0 * pi * self.heading_cutoff_hz or rate,
            round(self.max_gap * 1e9),
            round(self.magnetometer_timeout * 1e9),
            self.angle_random_walk,
            self.bias_sigma,
            self.inclination_sigma,
            self.heading_sigma,
            self.adaptive,
            self.learn_bias,
            1.0,
            self.integral_gain,
            self.rest_bias_time,
            _rest(self),
            _field(self),
        )


@dataclass(frozen=True)
class AhrsParameters(FilterParameters):
    """Parameters of the AHRS; noises are variances per step at 100 Hz, as ahrsfilter's."""

    implementation: str = parameter(
        'native', 'Kalman step: compiled, or filterpy.kalman', choices=('native', 'filterpy')
    )
    expected_field: float = parameter(
        50e-6, 'Strength of the magnetic field', unit='T', bounds=(1e-6, 1e-3), dynamic=True
    )
    accelerometer_noise: float = parameter(
        1.9247e-4, 'Variance', unit='(m/s²)²', bounds=(1e-12, 1e6), dynamic=True
    )
    magnetometer_noise: float = parameter(
        0.1, 'Variance', unit='µT²', bounds=(1e-9, 1e9), dynamic=True
    )
    gyroscope_noise: float = parameter(
        9.1385e-5, 'Variance', unit='(rad/s)²', bounds=(0.0, 1e3), dynamic=True
    )
    gyroscope_drift_noise: float = parameter(
        3.0462e-13, 'Variance of the bias step', unit='(rad/s)²', bounds=(0.0, 1e3), dynamic=True
    )
    linear_acceleration_noise: float = parameter(
        9.6236e-3, 'Variance', unit='(m/s²)²', bounds=(0.0, 1e6), dynamic=True
    )
    linear_acceleration_decay: float = parameter(
        0.5, 'Part left after a step', bounds=(0.0, 1.0), dynamic=True
    )
    magnetic_disturbance_noise: float = parameter(
        0.5, 'Variance', unit='µT²', bounds=(0.0, 1e9), dynamic=True
    )
    magnetic_disturbance_decay: float = parameter(
        0.5, 'Part left after a step', bounds=(0.0, 1.0), dynamic=True
    )

    step_interval: float = parameter(
        0.1, 'Adaptive: between Kalman steps', unit='s', bounds=(0.0, 1.0), dynamic=True
    )
    angle_random_walk: float = parameter(
        1e-3, 'Adaptive: of the gyroscope', unit='rad/√s', bounds=(0.0, 1.0), dynamic=True
    )
    rate_error: float = parameter(
        0.004,
        'Adaptive: error of the rate as its part, random over 1 s',
        bounds=(0.0, 1.0),
        dynamic=True,
    )
    bias_random_walk: float = parameter(
        1e-5, 'Adaptive: of the bias', unit='rad/s/√s', bounds=(0.0, 1.0), dynamic=True
    )
    acceleration_floor: float = parameter(
        0.05,
        'Adaptive: error density of specific force at rest',
        unit='m/s²·√s',
        bounds=(1e-6, 100.0),
        dynamic=True,
    )
    acceleration_weight: float = parameter(
        0.04,
        'Adaptive: part of the acceleration power that counts',
        unit='s',
        bounds=(0.0, 1e3),
        dynamic=True,
    )
    acceleration_memory: float = parameter(
        1.0,
        'Adaptive: time over which that power is averaged',
        unit='s',
        bounds=(0.0, 1e3),
        dynamic=True,
    )
    acceleration_smoothing: float = parameter(
        1.5,
        'Adaptive: low-pass of specific force in the world',
        unit='s',
        bounds=(0.0, 1e3),
        dynamic=True,
    )
    heading_noise: float = parameter(
        0.25,
        'Adaptive: error density of an undisturbed heading',
        unit='rad·√s',
        bounds=(1e-6, 100.0),
        dynamic=True,
    )
    rest_noise: float = parameter(
        1e-3,
        'Adaptive: error density of the resting gyroscope',
        unit='rad/s·√s',
        bounds=(1e-9, 1.0),
        dynamic=True,
    )
    initial_bias: float = parameter(
        0.01,
        'Adaptive: standard deviation of the bias at the start',
        unit='rad/s',
        bounds=(0.0, 1.0),
        dynamic=True,
    )

    def kernel_params(self) -> ahrs_kalman.Params:
        """Return what the kernel needs."""
        up, north = world_axes(self.world_frame, self.magnetic_declination)
        return ahrs_kalman.Params(
            up,
            north,
            self.use_magnetometer,
            self.expected_field * 1e6,
            round(self.max_gap * 1e9),
            round(self.magnetometer_timeout * 1e9),
            Noise(
                self.accelerometer_noise,
                self.magnetometer_noise,
                self.gyroscope_noise,
                self.gyroscope_drift_noise,
                self.linear_acceleration_noise,
                self.linear_acceleration_decay,
                self.magnetic_disturbance_noise,
                self.magnetic_disturbance_decay,
            ),
            AdaptiveParams(
                self.adaptive,
                self.learn_bias,
                self.step_interval,
                self.angle_random_walk,
                self.rate_error,
                self.bias_random_walk,
                self.acceleration_floor,
                self.acceleration_weight,
                self.acceleration_memory,
                self.acceleration_smoothing,
                self.heading_noise,
                self.rest_noise,
                0.05,
                0.1,
                self.initial_bias,
                _rest(self),
                _field(self),
            ),
        )


PRESETS: dict[str, dict[str, dict[str, Any]]] = {
    'complementary': {
        'paper': {},
        'robust': {
            'adaptive': True,
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


def check_mount(parameters: FilterParameters) -> None:
    """Refuse a mount that is no rotation."""
    mount = parameters.mount
    if len(mount) != 4 or not isclose(sum(x * x for x in mount), 1.0, abs_tol=1e-3):
        raise ParameterError(f'mount is {mount}, expected a unit quaternion x, y, z, w')


def world_axes(world_frame: str, declination: float) -> tuple[float, tuple[float, float]]:
    """Return world z of the upward direction, and world x, y of magnetic north."""
    east, north = sin(declination), cos(declination)
    return (-1.0, (north, east)) if world_frame == 'ned' else (1.0, (east, north))


def _rest(parameters: FilterParameters) -> RestParams:
    return RestParams(
        parameters.rest_angular_velocity,
        parameters.rest_linear_acceleration,
        parameters.rest_duration,
        0.5,
        parameters.bias_limit,
    )


def _field(parameters: FilterParameters) -> FieldParams:
    return FieldParams(parameters.field_tolerance, 0.5, 20.0, parameters.field_adoption, 0.35, 0.1)
