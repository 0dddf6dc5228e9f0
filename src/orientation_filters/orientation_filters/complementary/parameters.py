# SPDX-License-Identifier: Apache-2.0
"""Named parameters of the complementary filter."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import ClassVar

from imu_recording.ros.parameter import parameter

from orientation_filters.complementary.fixed_gain import Params
from orientation_filters.parameters import FilterParameters, Presets, world_axes
from orientation_filters.sample_checks import GRAVITY


@dataclass(frozen=True)
class ComplementaryParameters(FilterParameters):
    """Parameters of the complementary filter."""

    presets: ClassVar[Presets] = {
        'paper': {},
        'robust': {
            'adaptive': True,
            'learn_bias': True,
            'cutoff_hz': 0.03,
            'heading_cutoff_hz': 0.015,
            'angle_random_walk': 3e-4,
            'integral_gain': 0.0,
        },
    }
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
    learn_bias: bool = parameter(
        False, 'Learn the gyroscope bias: at rest, and in motion by integral_gain', dynamic=True
    )
    integral_gain: float = parameter(
        0.1,
        'Gain of bias learning in motion, as a part of cut-off²',
        bounds=(0.0, 10.0),
        dynamic=True,
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
        'Adaptive: angle random walk of the gyroscope',
        unit='rad/√s',
        bounds=(0.0, 1.0),
        dynamic=True,
    )
    bias_sigma: float = parameter(
        5e-3,
        'Standard deviation of the remaining bias, which turns the heading between fields',
        unit='rad/s',
        bounds=(0.0, 1.0),
        dynamic=True,
    )
    inclination_sigma: float = parameter(
        0.005,
        'Lasting error of specific force as a vertical, for the covariance',
        unit='rad',
        bounds=(0.0, pi),
        dynamic=True,
    )
    heading_sigma: float = parameter(
        0.01,
        'Lasting error of the field as a heading, for the covariance',
        unit='rad',
        bounds=(0.0, pi),
        dynamic=True,
    )

    def kernel_params(self) -> Params:
        """Return the parameters of the kernel."""
        up, north = world_axes(self.world_frame, self.magnetic_declination)
        rate = 2.0 * pi * self.cutoff_hz
        return Params(
            up=up,
            north=north,
            inclination_rate=rate,
            heading_rate=2.0 * pi * self.heading_cutoff_hz or rate,
            bias_sigma=self.bias_sigma,
            inclination_sigma=self.inclination_sigma,
            heading_sigma=self.heading_sigma,
            adaptive=self.adaptive,
            learn_bias=self.learn_bias,
            bias_rate=self.integral_gain,
            rest_bias_time=self.rest_bias_time,
            samples=self.sample_params(),
            rest=self.rest_params(),
            averaging=self.averaging_params(
                self.angle_random_walk,
                GRAVITY * self.angle_random_walk / rate,
                self.angle_random_walk / (2.0 * pi * self.heading_cutoff_hz or rate),
            ),
        )
