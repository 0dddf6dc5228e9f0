# SPDX-License-Identifier: Apache-2.0
"""Rest and slow steady turns are told apart by what gravity and field do, not by the rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_recording.recording import FloatArray, ImuRecording
from orientation_filters.errors import attitude_errors
from orientation_filters.filters import run_filter
from orientation_filters.result import AT_REST
from orientation_filters.rotation.arrays import conjugate, from_rotation_vector, multiply, rotate

from .recordings import random_attitude, rest, world_vectors

NAMES = ('complementary', 'ahrs')


def turntable(rate_deg_s: float, axis: list[float], seed: int) -> tuple[ImuRecording, FloatArray]:
    """Return 5 s of rest, then a minute of steady turning about a world axis, and the truth."""
    bias = np.radians([0.4, -0.3, 0.2])
    still = rest(random_attitude(seed), seed=seed, seconds=65, bias=bias, noise=0.3)
    angle = np.radians(rate_deg_s) * np.maximum(still.time - 5.0, 0.0)
    truth = multiply(from_rotation_vector(angle[:, None] * axis), random_attitude(seed))
    force, field = world_vectors('enu')
    spin = np.where(still.time[:, None] > 5.0, np.radians(rate_deg_s), 0.0) * np.array(axis)
    first = random_attitude(seed)
    return replace(
        still,
        angular_velocity=still.angular_velocity + rotate(conjugate(truth), spin),
        linear_acceleration=still.linear_acceleration
        + rotate(conjugate(truth), force)
        - rotate(conjugate(first), force),
        magnetic_field=still.magnetic_field
        + rotate(conjugate(truth), field)
        - rotate(conjugate(first), field),
    ), truth


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('rate_deg_s', [0.5, 2.0, 10.0])
@pytest.mark.parametrize('axis', [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
def test_a_slow_turn_is_not_taken_for_a_bias(
    name: str, rate_deg_s: float, axis: list[float]
) -> None:
    recording, truth = turntable(rate_deg_s, axis, seed=2)
    result = run_filter(name, recording, preset='robust')
    error = np.degrees(attitude_errors(result.orientation[500:], truth[500:]).rms()['total'])
    assert error < (2.5 if name == 'ahrs' else 4.0)


@pytest.mark.parametrize('name', NAMES)
def test_one_unusable_force_does_not_hide_a_slow_turn(name: str) -> None:
    recording, truth = turntable(2.0, [0.0, 0.0, 1.0], seed=2)
    force = recording.linear_acceleration.copy()
    force[100] = np.nan
    broken = replace(recording, linear_acceleration=force)
    result = run_filter(name, broken, preset='robust')
    error = np.degrees(attitude_errors(result.orientation[500:], truth[500:]).rms()['total'])
    assert error < (2.5 if name == 'ahrs' else 4.0)


@pytest.mark.parametrize('name', NAMES)
def test_a_field_that_never_stands_still_does_not_stop_learning(name: str) -> None:
    bias = np.radians([3.0, -2.0, 1.0])
    recording = rest(random_attitude(3), seed=3, seconds=40, bias=bias)
    hum = 30e-6 * np.sin(np.outer(recording.time, [3.0, 3.3, 2.0]))
    disturbed = replace(recording, magnetic_field=recording.magnetic_field + hum)
    result = run_filter(name, disturbed, preset='robust')
    assert np.degrees(np.abs(result.bias[-1] - bias)).max() < 0.3
    assert np.mean(result.flags & AT_REST != 0) > 0.5


@pytest.mark.parametrize('name', NAMES)
def test_a_start_amid_vibration_is_found_out(name: str) -> None:
    """The first sample may point anywhere; the mean of a few seconds does not."""
    for seed in range(3):
        truth = random_attitude(seed)
        recording = rest(truth, seed=seed, seconds=60)
        shaken = 15.0 * np.random.default_rng(seed).normal(size=(len(recording), 3))
        vibrating = replace(recording, linear_acceleration=recording.linear_acceleration + shaken)
        result = run_filter(name, vibrating, preset='robust')
        late = np.broadcast_to(truth, (1000, 4))
        rms = attitude_errors(result.orientation[-1000:], late).rms()
        assert np.degrees(rms['total']) < 20.0
