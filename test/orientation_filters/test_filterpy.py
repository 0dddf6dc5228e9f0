# SPDX-License-Identifier: Apache-2.0
"""The compiled Kalman step and filterpy's matrices give the same numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_recording.recording import ImuRecording
from orientation_filters.filters import run_filter
from orientation_filters.result import JAMMED
from orientation_filters.rotation.arrays import conjugate, from_rotation_vector, multiply, rotate
from static_data import random_attitude, rest, world_vectors


def moving(seed: int, seconds: float = 8.0, world_frame: str = 'enu') -> ImuRecording:
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
    field[::7] = np.nan
    return replace(
        still,
        stamp=still.stamp + rng.integers(0, 2_000_000, len(time)),
        angular_velocity=rate + 0.01,
        linear_acceleration=force + push,
        magnetic_field=field,
    )


@pytest.mark.parametrize('world_frame', ['enu', 'ned'])
@pytest.mark.parametrize('use_magnetometer', [True, False])
@pytest.mark.parametrize('preset', ['paper', 'robust'])
def test_native_equals_filterpy(world_frame: str, use_magnetometer: bool, preset: str) -> None:
    recording = moving(1, world_frame=world_frame)
    learn_bias = world_frame == 'enu' or not use_magnetometer
    options = {'world_frame': world_frame, 'use_magnetometer': use_magnetometer}
    options |= {'details': True, 'preset': preset, 'learn_bias': learn_bias}
    native = run_filter('ahrs', recording, **options)
    matrices = run_filter('ahrs', recording, implementation='filterpy', **options)
    np.testing.assert_array_equal(native.flags, matrices.flags)
    assert np.any(native.bias) == learn_bias
    assert np.any(native.flags & JAMMED) == use_magnetometer
    for name in ('orientation', 'packed_covariance', 'bias', 'linear_acceleration', 'inclination'):
        np.testing.assert_allclose(
            getattr(native, name), getattr(matrices, name), atol=1e-9, rtol=0
        )
    np.testing.assert_allclose(
        native.magnetic_disturbance * 1e6, matrices.magnetic_disturbance * 1e6, atol=1e-8
    )
