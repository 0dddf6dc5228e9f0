# SPDX-License-Identifier: Apache-2.0
"""Named parameters that both filters have: unit, range, meaning.

The defaults are the preset `paper`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, isclose, pi, sin
from typing import Any, ClassVar

from imu_recording.ros.parameter import ParameterError, parameter

from orientation_filters.magnetic_reference import FieldParams
from orientation_filters.rest_detection import RestParams
from orientation_filters.sample_checks import SampleParams
from orientation_filters.step_averages.accumulation import AveragingParams

WORLD_FRAMES = ('enu', 'ned', 'nwu')
PRESET_NAMES = ('paper', 'robust')
Presets = Mapping[str, Mapping[str, Any]]
"""Preset → values that differ from the defaults."""


@dataclass(frozen=True)
class FilterParameters:
    """Parameters both filters have."""

    presets: ClassVar[Presets] = {name: {} for name in PRESET_NAMES}

    preset: str = parameter(
        'paper',
        'Values of the parameters that are not set: as in the paper, or robust',
        choices=PRESET_NAMES,
    )
    world_frame: str = parameter(
        'enu',
        'Axes of the world: east north up, north east down, north west up',
        choices=WORLD_FRAMES,
    )
    use_magnetometer: bool = parameter(
        True, 'Heading from the magnetometer; false: from the gyroscope'
    )
    magnetic_declination: float = parameter(
        0.0, 'Of magnetic north from true north, east positive', unit='rad', bounds=(-pi, pi)
    )
    mount: list[float] = parameter(  # noqa: RUF009 (a default factory underneath)
        [0.0, 0.0, 0.0, 1.0], 'Rotation sensor → body, quaternion xyzw', bounds=(-1.0, 1.0)
    )
    max_gap: float = parameter(
        1.0, 'The attitude is set anew after a longer pause', unit='s', bounds=(1e-3, 3600.0)
    )
    magnetometer_timeout: float = parameter(
        0.5, 'How long a magnetometer sample holds', unit='s', bounds=(1e-3, 3600.0)
    )
    adaptive: bool = parameter(
        False, 'Adapt to acceleration, rest and magnetic disturbance', dynamic=True
    )
    learn_bias: bool = parameter(True, 'Learn the gyroscope bias', dynamic=True)
    rest_angular_velocity: float = parameter(
        0.035,
        'At rest: largest rms deviation from the mean',
        unit='rad/s',
        bounds=(0.0, 10.0),
        dynamic=True,
    )
    rest_linear_acceleration: float = parameter(
        0.3,
        'At rest: largest rms deviation from the mean',
        unit='m/s²',
        bounds=(0.0, 100.0),
        dynamic=True,
    )
    rest_duration: float = parameter(
        1.5, 'At rest: after so long without change', unit='s', bounds=(0.0, 3600.0), dynamic=True
    )
    bias_limit: float = parameter(
        0.2,
        'Larger rates at rest are not taken for a bias',
        unit='rad/s',
        bounds=(0.0, 10.0),
        dynamic=True,
    )
    field_tolerance: float = parameter(
        0.2,
        'Field disturbed: distance from the reference, as a part of its norm',
        bounds=(0.0, 10.0),
        dynamic=True,
    )
    field_adoption: float = parameter(
        60.0,
        'A new field becomes the reference after staying the same for',
        unit='s',
        bounds=(0.0, 1e6),
        dynamic=True,
    )
    step_interval: float = parameter(
        0.1, 'Adaptive: time between Kalman steps', unit='s', bounds=(0.0, 1.0), dynamic=True
    )
    rate_error: float = parameter(
        0.003,
        'Adaptive: error of the rate as a part of it, random over 1 s',
        bounds=(0.0, 1.0),
        dynamic=True,
    )
    bias_random_walk: float = parameter(
        2.5e-4,
        'Adaptive: random walk of the bias',
        unit='rad/s/√s',
        bounds=(0.0, 1.0),
        dynamic=True,
    )
    acceleration_weight: float = parameter(
        0.015,
        'Adaptive: error density of specific force per power of the acceleration',
        unit='s',
        bounds=(0.0, 1e3),
        dynamic=True,
    )
    acceleration_memory: float = parameter(
        2.0,
        'Adaptive: time constant of the mean power of the acceleration',
        unit='s',
        bounds=(0.0, 1e3),
        dynamic=True,
    )
    acceleration_smoothing: float = parameter(
        1.2,
        'Adaptive: time constant of the low-pass of specific force',
        unit='s',
        bounds=(0.0, 1e3),
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
    variance_factors: bool = parameter(
        True,
        'Adaptive: scale the covariance by what innovations show; false: as the noises make it',
        dynamic=True,
    )
    slow_weight: float = parameter(
        0.15,
        'Adaptive: error density of specific force per power that the low-pass leaves',
        unit='s',
        bounds=(0.0, 1e3),
        dynamic=True,
    )
    field_weight: float = parameter(
        1.5,
        "Adaptive: density of the heading's error per square of the field's deviation",
        unit='s',
        bounds=(0.0, 1e4),
        dynamic=True,
    )
    field_memory: float = parameter(
        20.0,
        "Adaptive: time constant of the mean square of the field's deviation",
        unit='s',
        bounds=(0.0, 1e4),
        dynamic=True,
    )

    def kernel_params(self) -> Any:
        """Return the parameters of the filter's kernel."""
        raise NotImplementedError

    def sample_params(self) -> SampleParams:
        """Return the parameters of the sample checks."""
        return SampleParams(
            use_magnetometer=self.use_magnetometer,
            max_gap=round(self.max_gap * 1e9),
            magnetometer_timeout=round(self.magnetometer_timeout * 1e9),
        )

    def rest_params(self) -> RestParams:
        """Return the parameters of rest detection."""
        return RestParams(
            angular_velocity=self.rest_angular_velocity,
            linear_acceleration=self.rest_linear_acceleration,
            duration=self.rest_duration,
            time_constant=0.5,
            bias_limit=self.bias_limit,
        )

    def field_params(self) -> FieldParams:
        """Return the parameters of the magnetic reference."""
        return FieldParams(
            tolerance=self.field_tolerance,
            hold=0.5,
            tracking=20.0,
            adoption=self.field_adoption,
            turning=0.35,
            smoothing=0.1,
        )

    def averaging_params(
        self, angle_random_walk: float, acceleration_floor: float, heading_noise: float
    ) -> AveragingParams:
        """Return the parameters of the means; noises [rad/√s], [m/s² √s], [rad √s]."""
        up, north = world_axes(self.world_frame, self.magnetic_declination)
        return AveragingParams(
            up=up,
            north=north,
            learn_bias=self.learn_bias,
            interval=self.step_interval,
            angle_random_walk=angle_random_walk,
            rate_error=self.rate_error,
            bias_random_walk=self.bias_random_walk,
            acceleration_floor=acceleration_floor,
            acceleration_weight=self.acceleration_weight,
            slow_weight=self.slow_weight,
            acceleration_memory=self.acceleration_memory,
            acceleration_smoothing=self.acceleration_smoothing,
            heading_noise=heading_noise,
            field_weight=self.field_weight,
            field_memory=self.field_memory,
            rest_noise=self.rest_noise,
            initial_inclination=0.6,
            initial_heading=1.8,
            initial_bias=self.initial_bias,
            variance_factors=self.variance_factors,
            rest=self.rest_params(),
            field=self.field_params(),
        )


def check_mount(parameters: FilterParameters) -> None:
    """Refuse a mount that is no rotation."""
    mount = parameters.mount
    if len(mount) != 4 or not isclose(sum(x * x for x in mount), 1.0, abs_tol=1e-3):
        raise ParameterError(f'mount is {mount}, expected a unit quaternion x, y, z, w')


def world_axes(world_frame: str, declination: float) -> tuple[float, tuple[float, float]]:
    """Return world z of the upward direction, and world x, y of magnetic north."""
    east, north = sin(declination), cos(declination)
    return {
        'enu': (1.0, (east, north)),
        'ned': (-1.0, (north, east)),
        'nwu': (1.0, (north, -east)),
    }[world_frame]
