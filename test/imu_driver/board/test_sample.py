# SPDX-License-Identifier: Apache-2.0
"""Samples: counts to SI units, axis maps, and messages equal to typed ones."""

import numpy as np
import pytest
from imu_driver.board import lsm9ds1
from imu_driver.board.sample import (
    AxisMapError,
    MessageBytes,
    Sample,
    SampleScale,
    parse_axis_map,
    rotation,
)
from imu_driver.wire.frames import MAGNETOMETER_NEW, TEMPERATURE_NEW, DataFrame
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu, MagneticField, Temperature

SAMPLE = Sample(
    1_234_567_890_123_456_789, (1.0, -2.0, 3.0), (4.0, 5.0, -6.0), (7e-6, 8e-6, -9e-6), 21.0625
)


@pytest.mark.parametrize('frame_id', ['', 'a', 'imu', 'imu_link', 'dut1/imu_link', 'größe'])
def test_they_read_back(frame_id: str) -> None:
    messages = MessageBytes(
        frame_id,
        angular_velocity_stddev=0.1,
        linear_acceleration_stddev=0.2,
        magnetic_field_stddev=3e-7,
    )
    raw = messages.imu(SAMPLE)
    imu = deserialize_message(raw, Imu)
    assert len(raw) == len(serialize_message(imu))
    assert (imu.header.stamp.sec, imu.header.stamp.nanosec) == (1_234_567_890, 123_456_789)
    assert imu.header.frame_id == frame_id
    rate, force = imu.angular_velocity, imu.linear_acceleration
    assert (rate.x, rate.y, rate.z) == SAMPLE.angular_velocity
    assert (force.x, force.y, force.z) == SAMPLE.linear_acceleration
    assert imu.orientation_covariance[0] == -1.0
    np.testing.assert_allclose(
        imu.angular_velocity_covariance.reshape(3, 3), 0.01 * np.eye(3), rtol=1e-12
    )
    np.testing.assert_allclose(
        imu.linear_acceleration_covariance.reshape(3, 3), 0.04 * np.eye(3), rtol=1e-12
    )

    raw = messages.magnetic_field(SAMPLE.stamp, SAMPLE.magnetic_field)
    magnetic = deserialize_message(raw, MagneticField)
    field = magnetic.magnetic_field
    assert len(raw) == len(serialize_message(magnetic))
    assert magnetic.header == imu.header
    assert (field.x, field.y, field.z) == SAMPLE.magnetic_field
    np.testing.assert_allclose(
        magnetic.magnetic_field_covariance.reshape(3, 3), 9e-14 * np.eye(3), rtol=1e-12
    )

    raw = messages.temperature(SAMPLE.stamp, SAMPLE.temperature)
    temperature = deserialize_message(raw, Temperature)
    assert len(raw) == len(serialize_message(temperature))
    assert temperature.header == imu.header
    assert temperature.temperature == 21.0625
    assert 0.0 < temperature.variance < 0.0625**2


def test_counts_become_si_units_in_the_published_frame() -> None:
    full_scale = {'gyroscope': 245.0, 'accelerometer': 16.0, 'magnetometer': 4.0}
    counts = (100, 0, 0, 0, 1000, 0, 500, 0, 0)
    frame = DataFrame(7, 1000, MAGNETOMETER_NEW | TEMPERATURE_NEW, -80, counts)
    sample = SampleScale(full_scale).sample(42, frame)
    assert sample.stamp == 42
    assert sample.angular_velocity[0] == pytest.approx(np.deg2rad(0.875))
    assert sample.linear_acceleration[1] == pytest.approx(0.732 * lsm9ds1.STANDARD_GRAVITY)
    assert sample.magnetic_field is not None
    assert sample.magnetic_field[0] == pytest.approx(-7e-6)  # chip x against the others' x
    assert sample.temperature == 20.0
    turned = SampleScale(full_scale, {'accelerometer': parse_axis_map('+y -x +z')})
    moved = turned.sample(42, frame._replace(flags=0))
    assert moved.linear_acceleration[0] == sample.linear_acceleration[1]
    assert (moved.magnetic_field, moved.temperature) == (None, None)


@pytest.mark.parametrize('text', ['+x +y +z', '-y +x +z', '+z,+x,+y', '-x-y+z', 'y z x'])
def test_axis_maps_are_rotations(text: str) -> None:
    matrix = rotation(parse_axis_map(text))
    np.testing.assert_array_equal(matrix @ matrix.T, np.eye(3))
    assert np.linalg.det(matrix) == pytest.approx(1.0)


MIRRORED = ('-x +y +z', '+y +x +z')
WRONG = ('+x +x +z', '+x +y', 'xyzw', '', '+x-y-q')


@pytest.mark.parametrize('text', MIRRORED + WRONG)
def test_other_axis_maps_are_refused(text: str) -> None:
    with pytest.raises(AxisMapError, match='axis map'):
        parse_axis_map(text)
