# SPDX-License-Identifier: Apache-2.0
"""The robust presets: hard to fool at rest, in motion, beside magnets, with thermal offsets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_recording.recording import FloatArray, ImuRecording
from orientation_filters.errors import attitude_errors
from orientation_filters.filters import run_filter
from orientation_filters.result import AT_REST, BIAS_LIMITED, DISTURBED
from orientation_filters.rotation.arrays import (
    conjugate,
    from_rotation_vector,
    heading_angle,
    multiply,
    rotate,
    rotation_angle,
)

from .recordings import random_attitude, rest, world_vectors

NAMES = ('complementary', 'ahrs')


def heading_error(q: FloatArray, truth: FloatArray) -> FloatArray:
    return np.degrees(heading_angle(multiply(q, conjugate(truth))))


def turning(seed: int, seconds: float = 120.0) -> tuple[ImuRecording, FloatArray]:
    """Return a recording of slow turns in all axes and its attitudes."""
    still = rest(random_attitude(seed), seed=seed, seconds=seconds, noise=0.1)
    rate = np.stack([0.6 * np.sin(k * still.time + seed) for k in (0.31, 0.47, 0.73)], axis=1)
    q = [random_attitude(seed)]
    for w in rate[1:]:
        q.append(multiply(q[-1], from_rotation_vector(w * 0.01)))
    truth = np.array(q)
    force, field = (rotate(conjugate(truth), v) for v in world_vectors('enu'))
    moved = replace(
        still,
        angular_velocity=still.angular_velocity + rate,
        linear_acceleration=force + 0.005 * np.random.default_rng(seed).normal(size=force.shape),
        magnetic_field=field,
    )
    return moved, truth


@pytest.mark.parametrize('name', NAMES)
def test_a_strong_field_for_a_minute_at_rest_turns_the_heading_little(name: str) -> None:
    worst = 0.0
    for seed in range(5):
        truth = random_attitude(seed)
        bias = np.radians([0.4, -0.3, 0.5])
        recording = rest(truth, seed=seed, seconds=180, bias=bias)
        field = recording.magnetic_field.copy()
        direction = rotate(
            conjugate(truth), np.array([1.0, 0.3, 0.2]) / np.linalg.norm([1, 0.3, 0.2])
        )
        during = slice(6000, 12000)
        field[during] += 200e-6 * direction
        result = run_filter(name, replace(recording, magnetic_field=field), preset='robust')
        assert np.all(result.flags[6050:12000] & DISTURBED)
        worst = max(worst, heading_error(result.orientation[during], truth).max())
        assert heading_error(result.orientation[-1000:], truth).max() < 1.0
        assert not np.any(result.flags[-1000:] & DISTURBED)
    assert worst <= 2.0


@pytest.mark.parametrize('name', NAMES)
def test_pushes_do_not_tilt(name: str) -> None:
    """Accelerations of ±5 m/s² that average out, ten times a reading's error, barely show."""
    recording, truth = turning(3)
    time = recording.time
    push = 5.0 * np.stack([np.sin(2 * np.pi * k * time) for k in (0.7, 0.9, 1.3)], axis=1)
    pushed = replace(
        recording,
        linear_acceleration=recording.linear_acceleration + rotate(conjugate(truth), push),
    )
    robust = run_filter(name, pushed, preset='robust').orientation
    paper = run_filter(name, pushed).orientation
    late = slice(3000, None)
    rms = [
        np.degrees(attitude_errors(q[late], truth[late]).rms()['total']) for q in (robust, paper)
    ]
    assert rms[0] < 2.0
    assert rms[0] < 0.5 * rms[1]


@pytest.mark.parametrize('name', NAMES)
def test_rest_teaches_a_large_thermal_bias_within_seconds(name: str) -> None:
    truth = random_attitude(4)
    bias = np.radians([6.0, -5.0, 4.0])
    result = run_filter(name, rest(truth, seed=4, seconds=20, bias=bias), preset='robust')
    assert np.degrees(np.abs(result.bias[-1] - bias)).max() < 0.1
    assert np.all(result.flags[500:] & AT_REST)


@pytest.mark.parametrize('name', NAMES)
def test_a_bias_on_a_ramp_is_followed_and_a_steady_one_stays_quiet(name: str) -> None:
    """1 °/s in 10 min, as a temperature ramp moves it: the bias lags less than 5 s behind."""
    truth = random_attitude(4)
    ramp = np.radians(1.0) / 600.0
    steady = rest(truth, seed=4, seconds=200.0, noise=0.2)
    moved = steady.angular_velocity + ramp * steady.time[:, None] * [0.6, 0.0, 0.8]
    late = slice(15_000, None)
    result = run_filter(name, replace(steady, angular_velocity=moved), preset='robust')
    expected = ramp * steady.time[late, None] * [0.6, 0.0, 0.8]
    assert np.abs((result.bias[late] - expected).mean(axis=0)).max() < 5.0 * ramp
    still = run_filter(name, steady, preset='robust').bias[late]
    assert np.std(still, axis=0).max() < 4.0 * ramp


@pytest.mark.parametrize('name', NAMES)
def test_a_bias_beyond_the_limit_is_not_learned_and_it_is_said(name: str) -> None:
    bias = np.radians([20.0, 0.0, 0.0])
    result = run_filter(name, rest(random_attitude(5), seed=5, bias=bias), preset='robust')
    assert np.all(result.flags[500:] & BIAS_LIMITED)


def test_motion_teaches_the_ahrs_the_bias() -> None:
    recording, truth = turning(6, seconds=240)
    bias = np.radians([0.5, -0.4, 0.3])
    biased = replace(recording, angular_velocity=recording.angular_velocity + bias)
    result = run_filter('ahrs', biased, preset='robust')
    assert not np.any(result.flags & AT_REST)
    assert np.degrees(np.abs(result.bias[-1] - bias)).max() < 0.06
    error = rotation_angle(multiply(result.orientation[-2000:], conjugate(truth[-2000:])))
    assert np.degrees(error).max() < 1.0


@pytest.mark.parametrize('name', NAMES)
def test_a_magnet_switched_on_in_motion_is_rejected_and_forgotten(name: str) -> None:
    recording, truth = turning(7)
    field = recording.magnetic_field.copy()
    field[6000:9000] += [60e-6, 0.0, 20e-6]
    result = run_filter(name, replace(recording, magnetic_field=field), preset='robust')
    disturbed = (result.flags & DISTURBED) != 0
    assert disturbed[6100:9000].mean() > 0.95
    assert not disturbed[9300:].any()
    assert heading_error(result.orientation, truth)[6000:9000].max() < 4.0
    assert heading_error(result.orientation, truth)[-500:].max() < 2.0


@pytest.mark.parametrize('name', NAMES)
def test_a_disturbed_start_is_found_out_and_corrected(name: str) -> None:
    recording, truth = turning(9, seconds=240)
    field = recording.magnetic_field.copy()
    early = slice(0, 500)
    field[early] += rotate(conjugate(truth[early]), np.array([20e-6, 15e-6, 10e-6]))
    result = run_filter(name, replace(recording, magnetic_field=field), preset='robust')
    error = heading_error(result.orientation, truth)
    assert error[499] > 15.0
    assert np.all(result.flags[600:1000] & DISTURBED)
    assert not np.any(result.flags[-15000:] & DISTURBED)
    assert error[-500:].max() < 2.0
    sigma = np.degrees(np.sqrt(result.covariance[2000:4000, 2, 2]))
    assert np.mean(sigma) < 0.4, 'half a minute later the heading is known again, and this is said'


def test_learning_can_be_switched_off() -> None:
    recording = rest(random_attitude(8), seed=8, seconds=20, bias=np.radians([1.0, 1.0, 1.0]))
    for name in NAMES:
        for preset in ('paper', 'robust'):
            result = run_filter(name, recording, preset=preset, learn_bias=False)
            assert np.all(result.bias == 0.0)


def test_learning_is_an_option_of_the_fixed_complementary_filter() -> None:
    bias = np.radians([1.0, -1.0, 1.0])
    recording = rest(random_attitude(8), seed=8, seconds=20, bias=bias)
    plain = run_filter('complementary', recording)
    taught = run_filter('complementary', recording, learn_bias=True)
    assert np.all(plain.bias == 0.0)
    assert np.degrees(np.abs(taught.bias[-1] - bias)).max() < 0.1


def test_covariance_covers_the_error_at_rest() -> None:
    for name in NAMES:
        inside = []
        for seed in range(30):
            truth = random_attitude(seed)
            result = run_filter(name, rest(truth, seed=seed, seconds=30), preset='robust')
            tilt = 2 * multiply(result.orientation[-1], conjugate(truth))[:2]
            sigma = np.sqrt(np.diag(result.covariance[-1]))[:2]
            inside += (np.abs(tilt) < 3 * sigma).tolist()
        assert np.mean(inside) > 0.9, name
