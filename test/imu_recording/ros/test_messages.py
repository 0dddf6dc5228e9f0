# SPDX-License-Identifier: Apache-2.0
"""Samples become messages and come back; nothing reaches a field that is not a float."""

import math

import numpy as np
from imu_recording.ros.messages import (
    ImuSample,
    MagneticSample,
    TemperatureSample,
    float_message,
    humidity_message,
    imu_from_sample,
    magnetic_field_from_sample,
    quaternion_message,
    sample_from_imu,
    sample_from_magnetic_field,
    sample_from_temperature,
    stamp_of,
    temperature_from_sample,
    vector_message,
)
from rclpy.serialization import deserialize_message, serialize_message

STAMP = 1_700_000_000_123_456_789


def over_the_wire(message):
    return deserialize_message(serialize_message(message), type(message))


def test_samples_survive_the_wire() -> None:
    imu = ImuSample(STAMP, (0.1, 0.2, 0.3), (1.0, 2.0, 9.8), tuple(range(9)), frame_id='a')
    wide = ImuSample(STAMP, tuple(np.float32([1, 2, 3])), (1, 2, 3), frame_id='a')
    for sample in (imu, wide):
        back = sample_from_imu(over_the_wire(imu_from_sample(sample)))
        assert back == sample
    magnetic = MagneticSample(STAMP, (1e-5, 2e-5, math.inf), (1,) * 9)
    assert sample_from_magnetic_field(over_the_wire(magnetic_field_from_sample(magnetic))) == (
        magnetic
    )
    warm = TemperatureSample(STAMP, 25, 0.1)
    assert sample_from_temperature(over_the_wire(temperature_from_sample(warm))) == warm


def test_orientation_is_unreported_unless_given() -> None:
    sample = ImuSample(STAMP, (0, 0, 0), (0, 0, 9.8))
    assert imu_from_sample(sample).orientation_covariance[0] == -1.0
    up = np.float32([0, 0, 1, 0])
    told = sample._replace(orientation=up, orientation_covariance=[1] * 9)
    told = over_the_wire(imu_from_sample(told))
    assert told.orientation.z == 1.0
    assert list(told.orientation_covariance) == [1.0] * 9


def test_unreported_vectors_read_as_nan() -> None:
    message = imu_from_sample(
        ImuSample(STAMP, (1, 2, 3), (0, 0, 9.8), angular_velocity_covariance=(-1.0,) + (0.0,) * 8)
    )
    sample = sample_from_imu(message)
    assert all(math.isnan(v) for v in sample.angular_velocity)
    assert sample.linear_acceleration == (0.0, 0.0, 9.8)


def test_other_tracks() -> None:
    assert over_the_wire(float_message(np.int64(3))).data == 3.0
    assert over_the_wire(humidity_message(STAMP, np.float32(0.5))).relative_humidity == 0.5
    vector = over_the_wire(vector_message(STAMP, np.arange(3)))
    assert (vector.vector.y, stamp_of(vector)) == (1.0, STAMP)
    assert over_the_wire(quaternion_message(STAMP, (0, 0, 0, 1))).quaternion.w == 1.0
