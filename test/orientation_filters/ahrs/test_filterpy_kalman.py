# SPDX-License-Identifier: Apache-2.0
"""The compiled Kalman step and filterpy's matrices give the same numbers."""

from __future__ import annotations

import numpy as np
import pytest
from orientation_filters.filters import run_filter
from orientation_filters.result import JAMMED

from ..recordings import moving


@pytest.mark.parametrize('world_frame', ['enu', pytest.param('ned', marks=pytest.mark.long)])
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
