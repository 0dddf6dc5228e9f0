# SPDX-License-Identifier: Apache-2.0
"""Every filter of the catalogue: sample by sample as in a batch, unharmed by unusable samples."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan
from typing import Any

import numpy as np
import pytest
from imu_recording.recording import ImuRecording
from imu_recording.ros.parameter import ParameterError
from orientation_filters.filters import (
    FILTERS,
    PARAMETERS,
    FilterError,
    filter_parameters,
    run_filter,
    sample_rate,
    state_bytes,
)
from orientation_filters.parameters import PRESET_NAMES
from orientation_filters.result import NOT_STARTED, OrientationResult
from orientation_filters.rotation.arrays import conjugate, multiply, rotation_angle

from .recordings import moving, random_attitude, rest, samples_of

pytestmark = pytest.mark.parametrize('name', FILTERS)


def spoiled(recording: ImuRecording) -> ImuRecording:
    """The recording with unusable rows in its first half."""
    w, f, m, stamp = (
        column.copy()
        for column in (
            recording.angular_velocity,
            recording.linear_acceleration,
            recording.magnetic_field,
            recording.stamp,
        )
    )
    f[0], f[50], f[51], f[52] = nan, inf, 0.0, 1e308
    w[60], w[61], w[62] = nan, -inf, 1e300
    m[70], m[71], m[72] = 0.0, inf, 1e300
    stamp[80] = stamp[79]
    return replace(
        recording, stamp=stamp, angular_velocity=w, linear_acceleration=f, magnetic_field=m
    )


@pytest.mark.parametrize('preset', PRESET_NAMES)
def test_a_batch_equals_its_samples_one_by_one(name: str, preset: str) -> None:
    recording = spoiled(moving(4, seconds=4.0))
    batch = run_filter(name, recording, preset=preset)
    params = filter_parameters(name, preset=preset).kernel_params()
    state = FILTERS[name].initial_state()
    for i, sample in enumerate(samples_of(recording)):
        state, estimate = FILTERS[name].update(state, params, sample)
        assert estimate.flags == batch.flags[i]
        if not estimate.flags & NOT_STARTED:
            np.testing.assert_array_equal(estimate.orientation, batch.orientation[i])
            np.testing.assert_array_equal(estimate.covariance, batch.packed_covariance[i])
            np.testing.assert_array_equal(state.bias, batch.bias[i])


@pytest.mark.parametrize('preset', PRESET_NAMES)
def test_unusable_samples_leave_no_trace(name: str, preset: str) -> None:
    truth = random_attitude(5)
    recording = rest(truth, seed=5, seconds=10.0, noise=0.1)
    result = run_filter(name, spoiled(recording), preset=preset)
    assert np.isfinite(result.orientation[1:]).all()
    assert np.isfinite(result.packed_covariance[1:]).all()
    error = rotation_angle(multiply(result.orientation[-1], conjugate(truth)))
    assert np.degrees(error) < 0.3


def test_states_are_named_and_small(name: str) -> None:
    module: Any = FILTERS[name]
    state = module.initial_state()
    assert type(state) is module.State
    assert state.stamp == -1
    assert 0 < state_bytes(name) < state_bytes(name, 'robust') < 2000


def test_results_have_one_row_per_sample(name: str) -> None:
    recording = rest(random_attitude(1), seed=1, seconds=1.0)
    result = run_filter(name, recording)
    assert isinstance(result, OrientationResult)
    assert result.covariance.shape == (len(recording), 3, 3)
    assert sample_rate(recording) == pytest.approx(100.0)


def test_what_does_not_exist_is_refused_with_what_does(name: str) -> None:
    with pytest.raises(FilterError, match='complementary, ahrs'):
        filter_parameters('extended')
    with pytest.raises(ParameterError, match=rf'unknown parameter cutoff; {name} has .*adaptive'):
        filter_parameters(name, cutoff=3.0)
    with pytest.raises(ParameterError, match='preset'):
        filter_parameters(name, preset='best')
    with pytest.raises(ParameterError, match=r'mount is .*unit quaternion'):
        filter_parameters(name, mount=[0.5, 0.0, 0.0, 0.0])


def test_every_preset_names_parameters_of_the_filter(name: str) -> None:
    for preset in PRESET_NAMES:
        assert vars(PARAMETERS[name]()).keys() >= PARAMETERS[name].presets[preset].keys()
