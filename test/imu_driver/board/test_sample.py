# SPDX-License-Identifier: Apache-2.0
"""Samples: counts to SI units, axis maps, and messages equal to typed ones."""

import numpy as np
import pytest
from imu_driver.board.sample import (
    AxisMapError,
    SampleScale,
    parse_axis_map,
    rotation,
)
from imu_driver.wire.frames import MAGNETOMETER_NEW, TEMPERATURE_NEW, DataFrame
from imu_recording.recording import STANDARD_GRAVITY


def test_counts_become_si_units_in_the_published_frame() -> None:
    full_scale = {'gyroscope': 245.0, 'accelerometer': 16.0, 'magnetometer': 4.0}
    counts = (100, 0, 0, 0, 1000, 0, 500, 0, 0)
    frame = DataFrame(7, 1000, MAGNETOMETER_NEW | TEMPERATURE_NEW, -80, counts)
    sample = SampleScale(full_scale).sample(42, frame)
    assert sample.stamp == 42
    assert sample.angular_velocity[0] == pytest.approx(np.deg2rad(0.875))
    assert sample.linear_acceleration[1] == pytest.approx(0.732 * STANDARD_GRAVITY)
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
