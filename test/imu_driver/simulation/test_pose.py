# SPDX-License-Identifier: Apache-2.0
"""Poses and known rotations: gyroscope, gravity and attitude belong together."""

import numpy as np
import pytest
from imu_driver.simulation.environment import MAGNETIC_FIELD, constant_environment
from imu_driver.simulation.pose import (
    Motion,
    into_sensor_frame,
    pose_matrix,
    rotation_vector_matrix,
    turns_with_rests,
)
from imu_driver.simulation.read_out import ReadOut, read_out
from imu_driver.simulation.run import prepare_run
from imu_recording.recording import UP_AXES
from scipy.spatial.transform import Rotation

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
HALF_PI = np.pi / 2.0


@pytest.mark.parametrize('axis', UP_AXES)
def test_a_pose_is_a_rotation_that_lifts_its_axis(axis: str) -> None:
    matrix = pose_matrix(axis)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    up = matrix @ [0.0, 0.0, 1.0]
    assert up['xyz'.index(axis[1])] == (1.0 if axis[0] == '+' else -1.0)
    quaternion, _ = Motion(()).at(np.zeros(2), axis)
    np.testing.assert_allclose(
        into_sensor_frame(quaternion, MAGNETIC_FIELD)[1], matrix @ MAGNETIC_FIELD, atol=1e-18
    )


def test_an_unknown_pose_is_named() -> None:
    with pytest.raises(ValueError, match=r"'up' is none of \+x"):
        pose_matrix('up')


def test_rotation_vectors_agree_with_scipy() -> None:
    for vector in np.random.default_rng(1).normal(size=(20, 3)):
        np.testing.assert_allclose(
            rotation_vector_matrix(vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-12
        )


def test_turns_end_where_their_angles_say() -> None:
    motion = turns_with_rests([(X, HALF_PI), (Y, -1.0), (Z, 2.0)], start=5, duration=3, rest=2)
    quaternion, rate = motion.at(np.array([0.0, 30.0]), '+z')
    wanted = Rotation.from_rotvec([HALF_PI, 0, 0]) * Rotation.from_rotvec([0, -1, 0])
    wanted = wanted * Rotation.from_rotvec([0, 0, 2])
    assert (Rotation.from_quat(quaternion[1]).inv() * wanted).magnitude() < 1e-9
    np.testing.assert_array_equal(rate, 0.0)


def test_rates_integrate_to_the_attitude() -> None:
    motion = turns_with_rests([(X, HALF_PI), ((0.6, 0.0, 0.8), 2.5)], start=1, duration=4, rest=1)
    time = np.arange(0.0, 12.0, 1e-3)
    quaternion, rate = motion.at(time, '+y')
    attitude = Rotation.from_quat(quaternion[0])
    for middle in 0.5 * (rate[1:] + rate[:-1]):
        attitude = attitude * Rotation.from_rotvec(middle * 1e-3)
    assert (attitude.inv() * Rotation.from_quat(quaternion[-1])).magnitude() < 1e-5


def test_a_turned_device_feels_gravity_and_field_of_its_attitude() -> None:
    motion = turns_with_rests([(Y, HALF_PI)], start=20.0, duration=4.0, rest=1.0)
    run = prepare_run('dut3', constant_environment(20.0, 60.0), seed=2, motion=motion)
    recording = read_out(run, ReadOut(100.0))
    before, after = recording.time < 15.0, recording.time > 30.0
    force = [recording.linear_acceleration[rows].mean(axis=0) for rows in (before, after)]
    field = [recording.magnetic_field[rows].mean(axis=0) for rows in (before, after)]
    # Pitch by +90° turns +z into the horizontal and −x upwards: the change has no bias in it.
    np.testing.assert_allclose(force[1] - force[0], [-9.8, 0.0, -9.8], atol=0.15)
    east, north, up = MAGNETIC_FIELD
    wanted = np.array([-up, north, east]) - np.array([east, north, up])
    np.testing.assert_allclose(field[1] - field[0], wanted, atol=1e-6)
    turned = np.trapezoid(recording.angular_velocity[:, 1], recording.time)
    rest = recording.angular_velocity[before, 1].mean() * recording.time[-1]
    assert turned - rest == pytest.approx(HALF_PI, rel=0.02)  # scale error of the gyroscope
    assert recording.reference_orientation is not None
    assert recording.reference_orientation.shape == (len(recording), 4)


def test_means_of_a_moving_device_are_refused() -> None:
    motion = turns_with_rests([(Y, 1.0)], start=2.0, duration=2.0, rest=1.0)
    run = prepare_run('dut1', constant_environment(20.0, 10.0), seed=1, motion=motion)
    with pytest.raises(ValueError, match='moving'):
        read_out(run, ReadOut(1.0, mean=True))
