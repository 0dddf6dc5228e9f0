# SPDX-License-Identifier: Apache-2.0
"""Synthetic recordings: at rest in a known attitude with white noise and a bias, and in motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording
from orientation_filters.rotation.arrays import (
    conjugate,
    from_rotation_vector,
    multiply,
    normalised,
    rotate,
)
from orientation_filters.sample_checks import Sample

GRAVITY = 9.81
FIELD = 50e-6
DIP = np.radians(50.0)

ACCELEROMETER_SIGMA = np.sqrt(1.9247e-4)
GYROSCOPE_SIGMA = np.sqrt(9.1385e-5)
MAGNETOMETER_SIGMA = np.sqrt(0.1) * 1e-6


def world_vectors(world_frame: str) -> tuple[FloatArray, FloatArray]:
    """Return specific force at rest [m/s²] and field [T] in the world."""
    level, sunk = FIELD * np.cos(DIP), FIELD * np.sin(DIP)
    if world_frame == 'ned':
        return np.array([0, 0, -GRAVITY]), np.array([level, 0, sunk])
    if world_frame == 'nwu':
        return np.array([0, 0, GRAVITY]), np.array([level, 0, -sunk])
    return np.array([0, 0, GRAVITY]), np.array([0, level, -sunk])


def rest(
    attitude: FloatArray,
    *,
    seed: int,
    seconds: float = 60.0,
    rate_hz: float = 100.0,
    bias: FloatArray | None = None,
    noise: float = 1.0,
    world_frame: str = 'enu',
) -> ImuRecording:
    """Return a recording at rest; attitude sensor → world, bias of the gyroscope [rad/s]."""
    rng = np.random.default_rng(seed)
    n = round(seconds * rate_hz)
    force, field = (rotate(conjugate(attitude), v) for v in world_vectors(world_frame))
    offset = np.zeros(3) if bias is None else bias
    return ImuRecording(
        stamp=1_000_000_000 + np.arange(n) * round(1e9 / rate_hz),
        angular_velocity=offset + noise * GYROSCOPE_SIGMA * rng.normal(size=(n, 3)),
        linear_acceleration=force + noise * ACCELEROMETER_SIGMA * rng.normal(size=(n, 3)),
        magnetic_field=field + noise * MAGNETOMETER_SIGMA * rng.normal(size=(n, 3)),
        temperature=np.full(n, 20.0),
    )


def random_attitude(seed: int) -> FloatArray:
    """Return a uniformly random attitude."""
    return normalised(np.random.default_rng(seed).normal(size=4))


def samples_of(recording: ImuRecording) -> list[Sample]:
    """Return the rows as the samples a filter takes one by one."""
    columns = (recording.angular_velocity, recording.linear_acceleration, recording.magnetic_field)
    rows = zip(recording.stamp.tolist(), *(c.tolist() for c in columns), strict=True)
    return [Sample(stamp, tuple(w), tuple(f), tuple(m)) for stamp, w, f, m in rows]


def moving(
    seed: int, seconds: float = 8.0, world_frame: str = 'enu', *, first_field: bool = False
) -> ImuRecording:
    """Return a recording of smooth rotation with pushes, lost and disturbed fields."""
    rng = np.random.default_rng(seed)
    still = rest(random_attitude(seed), seed=seed, seconds=seconds, world_frame=world_frame)
    time = still.time
    rate = np.stack([np.sin(time * k + k) * k for k in (0.5, 0.9, 1.3)], axis=1)
    q = [random_attitude(seed)]
    for w in rate[1:]:
        q.append(multiply(q[-1], from_rotation_vector(w * 0.01)))
    force, field = (rotate(conjugate(np.array(q)), v) for v in world_vectors(world_frame))
    push = np.where(np.sin(time * 2.0)[:, None] > 0.7, 3.0, 0.0) * rng.normal(size=(len(time), 3))
    field[400:450] += 300e-6
    field[3 if first_field else 0 :: 7] = np.nan
    return replace(
        still,
        stamp=still.stamp + rng.integers(0, 2_000_000, len(time)),
        angular_velocity=rate + 0.01,
        linear_acceleration=force + push,
        magnetic_field=field,
    )
