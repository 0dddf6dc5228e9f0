# SPDX-License-Identifier: Apache-2.0
"""Quaternions as arrays (…, 4) xyzw, Hamilton, sensor → world.

The same algebra on tuples of scalars, for compiled kernels, is in `scalars`.
"""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray

IDENTITY: FloatArray = np.array([0.0, 0.0, 0.0, 1.0])

ENU_FROM: dict[str, FloatArray] = {
    'enu': IDENTITY,
    'ned': np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]),
    'nwu': np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]),
}
"""World frame → rotation that takes its coordinates to ENU coordinates."""


def conjugate(q: FloatArray) -> FloatArray:
    """Return the inverse rotations.

    >>> conjugate(np.array([0.6, 0.0, 0.0, 0.8])).tolist()
    [-0.6, -0.0, -0.0, 0.8]
    """
    inverse: FloatArray = q * np.array([-1.0, -1.0, -1.0, 1.0])
    return inverse


def multiply(p: FloatArray, q: FloatArray) -> FloatArray:
    """Return p ⊗ q: first q, then p; shapes broadcast.

    >>> quarter = np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    >>> np.round(multiply(quarter, quarter), 12).tolist()
    [0.0, 0.0, 1.0, 0.0]
    """
    px, py, pz, pw = np.moveaxis(np.asarray(p), -1, 0)
    qx, qy, qz, qw = np.moveaxis(np.asarray(q), -1, 0)
    return np.stack(
        [
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
            pw * qw - px * qx - py * qy - pz * qz,
        ],
        axis=-1,
    )


def normalised(q: FloatArray) -> FloatArray:
    """Return unit quaternions with w ≥ 0.

    >>> normalised(np.array([0.0, 0.0, 3.0, -4.0])).tolist()
    [-0.0, -0.0, -0.6, 0.8]
    """
    length = np.linalg.norm(q, axis=-1, keepdims=True)
    unit: FloatArray = q / length * np.where(q[..., 3:] < 0, -1.0, 1.0)
    return unit


def to_matrix(q: FloatArray) -> FloatArray:
    """Return rotation matrices (…, 3, 3), sensor → world.

    >>> to_matrix(np.array([0.0, 0.0, 1.0, 0.0])).tolist()
    [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    x, y, z, w = np.moveaxis(np.asarray(q), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotate(q: FloatArray, v: FloatArray) -> FloatArray:
    """Return the vectors (…, 3) rotated by q: sensor coordinates become world coordinates.

    >>> rotate(np.array([0.0, 0.0, 1.0, 0.0]), np.array([1.0, 2.0, 3.0])).tolist()
    [-1.0, -2.0, 3.0]
    """
    q, v = np.asarray(q), np.asarray(v)
    twice = 2.0 * np.cross(q[..., :3], v)
    turned: FloatArray = v + q[..., 3:] * twice + np.cross(q[..., :3], twice)
    return turned


def from_rotation_vector(v: FloatArray) -> FloatArray:
    """Return the rotations by |v| [rad] about v.

    >>> np.round(from_rotation_vector(np.array([0.0, 0.0, np.pi])), 12).tolist()
    [0.0, 0.0, 1.0, 0.0]
    """
    v = np.asarray(v, dtype=np.float64)
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([v * 0.5 * np.sinc(angle / (2 * np.pi)), np.cos(angle / 2)], axis=-1)


def to_rotation_vector(q: FloatArray) -> FloatArray:
    """Return the rotation vectors [rad], |v| ≤ π.

    >>> to_rotation_vector(np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])).round(6).tolist()
    [0.0, 0.0, 1.570796]
    """
    q = np.asarray(q)
    q = q * np.where(q[..., 3:] < 0, -1.0, 1.0)
    sine = np.linalg.norm(q[..., :3], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[..., 3:])
    factor = np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 1e-12)
    vector: FloatArray = q[..., :3] * factor
    return vector


def rotation_angle(q: FloatArray) -> FloatArray:
    """Return the angle of each rotation [rad], 0 … π."""
    angle: FloatArray = 2.0 * np.arctan2(np.linalg.norm(q[..., :3], axis=-1), np.abs(q[..., 3]))
    return angle


def heading_angle(q: FloatArray) -> FloatArray:
    """Return the part of each rotation about the vertical [rad], 0 … π (BROAD's heading error).

    >>> np.degrees(heading_angle(np.array([0.0, 0.0, np.sin(0.1), np.cos(0.1)]))).round(3)
    np.float64(11.459)
    """
    angle: FloatArray = 2.0 * np.arctan2(np.abs(q[..., 2]), np.abs(q[..., 3]))
    return angle


def inclination_angle(q: FloatArray) -> FloatArray:
    """Return the part of each rotation that tilts the vertical [rad], 0 … π."""
    tilt = np.hypot(q[..., 0], q[..., 1])
    angle: FloatArray = 2.0 * np.arctan2(tilt, np.hypot(q[..., 2], q[..., 3]))
    return angle


def euler_zyx(q: FloatArray) -> FloatArray:
    """Return roll, pitch, yaw (…, 3) [rad] of R = Rz(yaw) Ry(pitch) Rx(roll).

    At pitch ±90° roll and yaw are one angle; it is then given as yaw, with roll 0.

    >>> np.degrees(euler_zyx(np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]))).round(6).tolist()
    [0.0, 90.0, 0.0]
    """
    x, y, z, w = np.moveaxis(np.asarray(q), -1, 0)
    sine = np.clip(2.0 * (w * y - x * z), -1.0, 1.0)
    locked = np.abs(sine) > 1.0 - 1e-12
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    yaw = np.where(locked, 0.0 - np.sign(sine) * 2.0 * np.arctan2(x, w), yaw)
    return np.stack([np.where(locked, 0.0, roll), np.arcsin(sine), yaw], axis=-1) + 0.0


def enu_from(world_frame: str, q: FloatArray) -> FloatArray:
    """Return sensor → ENU from sensor → `world_frame` (a key of ENU_FROM).

    >>> east = rotate(enu_from('nwu', IDENTITY), np.array([0.0, -1.0, 0.0]))  # −west
    >>> east.round(9).tolist()
    [1.0, 0.0, 0.0]
    """
    return normalised(multiply(ENU_FROM[world_frame], q))
