# SPDX-License-Identifier: Apache-2.0
"""Named parameters of the AHRS."""

from __future__ import annotations

from dataclasses import dataclass

from imu_recording.ros.parameter import parameter

from orientation_filters.ahrs import filter as ahrs_kalman
from orientation_filters.ahrs.adaptive import AdaptiveParams
from orientation_filters.ahrs.measurement_update import Noise
from orientation_filters.parameters import FilterParameters, world_axes


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
                self.rest_params(),
                self.field_params(),
            ),
        )
