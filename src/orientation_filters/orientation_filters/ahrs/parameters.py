# SPDX-License-Identifier: Apache-2.0
"""Named parameters of the AHRS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from imu_recording.ros.parameter import parameter

from orientation_filters.ahrs.state import Noise, Params
from orientation_filters.parameters import FilterParameters, Presets, world_axes


@dataclass(frozen=True)
class AhrsParameters(FilterParameters):
    """Parameters of the AHRS; noises are variances per step at 100 Hz, as ahrsfilter's."""

    presets: ClassVar[Presets] = {'paper': {}, 'robust': {'adaptive': True}}
    implementation: str = parameter(
        'native', 'Kalman step: compiled, or filterpy.kalman', choices=('native', 'filterpy')
    )
    expected_field: float = parameter(
        50e-6, 'Strength of the magnetic field', unit='T', bounds=(1e-6, 1e-3), dynamic=True
    )
    accelerometer_noise: float = parameter(
        1.9247e-4, 'Variance of a sample', unit='(m/s²)²', bounds=(1e-12, 1e6), dynamic=True
    )
    magnetometer_noise: float = parameter(
        0.1, 'Variance of a sample', unit='µT²', bounds=(1e-9, 1e9), dynamic=True
    )
    gyroscope_noise: float = parameter(
        9.1385e-5, 'Variance of a sample', unit='(rad/s)²', bounds=(0.0, 1e3), dynamic=True
    )
    gyroscope_drift_noise: float = parameter(
        3.0462e-13, 'Variance of the bias step', unit='(rad/s)²', bounds=(0.0, 1e3), dynamic=True
    )
    linear_acceleration_noise: float = parameter(
        9.6236e-3,
        'Variance of its change in a step',
        unit='(m/s²)²',
        bounds=(0.0, 1e6),
        dynamic=True,
    )
    linear_acceleration_decay: float = parameter(
        0.5, 'Part of it left after a step', bounds=(0.0, 1.0), dynamic=True
    )
    magnetic_disturbance_noise: float = parameter(
        0.5, 'Variance of its change in a step', unit='µT²', bounds=(0.0, 1e9), dynamic=True
    )
    magnetic_disturbance_decay: float = parameter(
        0.5, 'Part of it left after a step', bounds=(0.0, 1.0), dynamic=True
    )

    angle_random_walk: float = parameter(
        3e-4,
        'Adaptive: angle random walk of the gyroscope',
        unit='rad/√s',
        bounds=(0.0, 1.0),
        dynamic=True,
    )
    acceleration_floor: float = parameter(
        0.01,
        'Adaptive: error density of specific force at rest',
        unit='m/s²·√s',
        bounds=(1e-6, 100.0),
        dynamic=True,
    )
    heading_noise: float = parameter(
        0.004,
        'Adaptive: error density of an undisturbed heading',
        unit='rad·√s',
        bounds=(1e-6, 100.0),
        dynamic=True,
    )

    def kernel_params(self) -> Params:
        """Return the parameters of the kernel."""
        up, north = world_axes(self.world_frame, self.magnetic_declination)
        return Params(
            up=up,
            north=north,
            field_strength=self.expected_field * 1e6,
            learn_bias=self.learn_bias,
            samples=self.sample_params(),
            noise=Noise(
                accelerometer=self.accelerometer_noise,
                magnetometer=self.magnetometer_noise,
                gyroscope=self.gyroscope_noise,
                gyroscope_drift=self.gyroscope_drift_noise,
                linear_acceleration=self.linear_acceleration_noise,
                linear_acceleration_decay=self.linear_acceleration_decay,
                magnetic_disturbance=self.magnetic_disturbance_noise,
                magnetic_disturbance_decay=self.magnetic_disturbance_decay,
            ),
            adaptive=self.adaptive,
            averaging=self.averaging_params(
                self.angle_random_walk, self.acceleration_floor, self.heading_noise
            ),
        )
