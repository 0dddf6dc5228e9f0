# SPDX-License-Identifier: Apache-2.0
"""Attitude of a simulated device: at rest in the fixture, or turned by known rotations.

The chamber's frame is ENU. In the pose +z the sensor's axes are (E, N, U), in +x (U, E, N), in +y
(N, U, E). In −x, −y, −z that pose is turned by 180° about the axis that follows the upward one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from imu_recording.recording import UP_AXES, FloatArray
from imu_recording.user_error import UserError


def pose_matrix(up_axis: str) -> FloatArray:
    """Return (3, 3): world (ENU) → sensor frame of a device whose `up_axis` points up."""
    if up_axis not in UP_AXES:
        raise UserError(f'orientation {up_axis!r} is none of {", ".join(UP_AXES)}')
    up = 'xyz'.index(up_axis[1])
    matrix = np.roll(np.eye(3), up + 1, axis=0)
    if up_axis[0] == '-':
        turn = -np.eye(3)
        after = (up + 1) % 3
        turn[after, after] = 1.0
        matrix = turn @ matrix
    return matrix


def rotation_vector_matrix(vector: FloatArray) -> FloatArray:
    """Return (3, 3) the rotation by a vector [rad] (Rodrigues).

    >>> rotation_vector_matrix(np.array([0, 0, np.pi / 2])).round(6) @ [1, 0, 0]
    array([0., 1., 0.])
    """
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: FloatArray = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return turned


class Turn(NamedTuple):
    """One rotation about an axis of the sensor, from rest to rest."""

    start: float
    """[s]"""
    duration: float
    """[s]"""
    axis: tuple[float, float, float]
    """Unit vector, sensor frame."""
    angle: float
    """[rad]"""


@dataclass(frozen=True)
class Motion:
    """Turns one after the other; between them the device rests.

    The rate of a turn is a raised cosine, ω(s) = angle/duration · (1 − cos 2πs), s = 0 … 1.
    """

    turns: tuple[Turn, ...]

    def at(self, time: FloatArray, up_axis: str) -> tuple[FloatArray, FloatArray]:
        """Return attitude and rate at `time` (n,) [s].

        (n, 4) quaternion xyzw, sensor → ENU, and (n, 3) true angular velocity, sensor frame
        [rad/s].
        """
        rate = np.zeros((len(time), 3))
        quaternion = np.tile(_quaternion(pose_matrix(up_axis).T), (len(time), 1))
        for turn in self.turns:
            s = np.clip((time - turn.start) / turn.duration, 0.0, 1.0)
            axis = np.array(turn.axis)
            half = 0.5 * turn.angle * (s - np.sin(2 * np.pi * s) / (2 * np.pi))
            step = np.column_stack([np.sin(half)[:, None] * axis, np.cos(half)])
            quaternion = _multiply(quaternion, step)
            speed = turn.angle / turn.duration * (1.0 - np.cos(2 * np.pi * s))
            rate += np.where((s > 0) & (s < 1), speed, 0.0)[:, None] * axis
        return quaternion, rate


def into_sensor_frame(quaternion: FloatArray, world: FloatArray) -> FloatArray:
    """Return (n, 3) a world vector (3,) as seen in the sensor frame, attitude (n, 4) xyzw."""
    vector, scalar = quaternion[:, :3], quaternion[:, 3:]
    # v' = R(q)ᵀ v = v + 2 q₀ (v × q) + 2 q × (q × v), signs of the inverse rotation
    cross = np.cross(vector, world)
    turned: FloatArray = world - 2.0 * scalar * cross + 2.0 * np.cross(vector, cross)
    return turned


def _multiply(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the Hamilton product of quaternions (n, 4) xyzw."""
    vector = (
        left[:, 3:] * right[:, :3]
        + right[:, 3:] * left[:, :3]
        + np.cross(left[:, :3], right[:, :3])
    )
    scalar = left[:, 3] * right[:, 3] - np.sum(left[:, :3] * right[:, :3], axis=1)
    return np.column_stack([vector, scalar])


def _quaternion(matrix: FloatArray) -> FloatArray:
    """Return (4,) xyzw of a rotation matrix, largest component first (Shepperd 1978)."""
    trace = np.trace(matrix)
    candidates = np.array([*(2.0 * np.diag(matrix) - trace), trace]) + 1.0
    largest = int(np.argmax(candidates))
    q = np.empty(4)
    q[largest] = candidates[largest]
    if largest == 3:
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            q[i] = matrix[k, j] - matrix[j, k]
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q[j] = matrix[j, i] + matrix[i, j]
        q[k] = matrix[k, i] + matrix[i, k]
        q[3] = matrix[k, j] - matrix[j, k]
    unit: FloatArray = q / np.linalg.norm(q)
    return unit


def turns_with_rests(
    rotations: Sequence[tuple[tuple[float, float, float], float]],
    *,
    start: float,
    duration: float,
    rest: float,
) -> Motion:
    """Return equally long turns (axis, angle [rad]) with rests between them [s]."""
    return Motion(
        tuple(
            Turn(start=start + k * (duration + rest), duration=duration, axis=axis, angle=angle)
            for k, (axis, angle) in enumerate(rotations)
        )
    )
