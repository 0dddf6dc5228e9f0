# SPDX-License-Identifier: Apache-2.0
"""Compensated measurements as samples, with the covariance messages carry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imu_recording.messages import ImuSample, MagneticSample

from thermal_comp.compensator import CompensatedVector

NOT_REPORTED = -1.0
"""First element of the covariance of a measurement that is not there (REP-145)."""


def output_covariance(given: tuple[float, ...], measured: CompensatedVector) -> tuple[float, ...]:
    """Return nine numbers, row-major: the sensor's noise plus what the model does not know.

    `given` is the covariance the measurement came with: kept where it says there is none, taken
    as the sensor's noise where it is known, else the model's own noise stands in.
    """
    if given[0] == NOT_REPORTED:
        return given
    noise = np.array(given).reshape(3, 3) if any(given) else np.diag(measured.noise_variance)
    return tuple((noise + measured.covariance).ravel().tolist())


def compensated_imu(
    sample: ImuSample, rate: CompensatedVector, force: CompensatedVector
) -> ImuSample:
    """Return the sample with compensated angular velocity and linear acceleration."""
    return replace(
        sample,
        angular_velocity=rate.value,
        linear_acceleration=force.value,
        angular_velocity_covariance=output_covariance(sample.angular_velocity_covariance, rate),
        linear_acceleration_covariance=output_covariance(
            sample.linear_acceleration_covariance, force
        ),
    )


def compensated_field(sample: MagneticSample, field: CompensatedVector) -> MagneticSample:
    """Return the sample with the compensated magnetic field."""
    covariance = output_covariance(sample.magnetic_field_covariance, field)
    return replace(sample, magnetic_field=field.value, magnetic_field_covariance=covariance)
