# SPDX-License-Identifier: Apache-2.0
"""The covariance of fixed gains says what they err by: accelerated, disturbed, and at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_recording.recording import FloatArray, ImuRecording
from orientation_filters.errors import normalised_errors
from orientation_filters.filters import FILTERS, run_filter
from orientation_filters.rotation.arrays import conjugate, from_rotation_vector, multiply, rotate

from .recordings import (
    ACCELEROMETER_SIGMA,
    MAGNETOMETER_SIGMA,
    random_attitude,
    rest,
    world_vectors,
)

SECONDS = 90.0
CHI2_95 = 7.815
"""95 % of chi-square with three degrees of freedom."""


def swung(
    seed: int, *, acceleration: float = 0.0, field: float = 0.0
) -> tuple[ImuRecording, FloatArray]:
    """Return a swinging device and its attitudes.

    It is accelerated at 0.5 Hz by `acceleration` [m/s²], its field is off by `field` [T] for the
    second of three thirds.
    """
    rng = np.random.default_rng(seed)
    still = rest(random_attitude(seed), seed=seed, seconds=SECONDS)
    time, n = still.time, len(still)
    rate = np.stack([np.sin(time * k + seed) * k for k in (0.5, 0.9, 1.3)], axis=1)
    q = [random_attitude(seed)]
    for w in 0.5 * (rate[1:] + rate[:-1]):
        q.append(multiply(q[-1], from_rotation_vector(w * 0.01)))
    truth = np.array(q)
    up, north = world_vectors('enu')
    level = np.append(rng.normal(size=2), 0.0)
    level /= np.linalg.norm(level)
    push = acceleration * np.sin(np.pi * time)[:, None] * level
    off = np.where(np.abs(time - 45.0)[:, None] < 15.0, field, 0.0) * level
    recording = replace(
        still,
        angular_velocity=still.angular_velocity + rate,
        linear_acceleration=rotate(conjugate(truth), up + push)
        + ACCELEROMETER_SIGMA * rng.normal(size=(n, 3)),
        magnetic_field=rotate(conjugate(truth), north + off)
        + MAGNETOMETER_SIGMA * rng.normal(size=(n, 3)),
    )
    return recording, truth


def honesty(name: str, recording: ImuRecording, truth: FloatArray) -> tuple[float, float]:
    """Return normalised squared error per degree of freedom and the share within 95 %."""
    result = run_filter(name, recording, preset='paper')
    squares = normalised_errors(result.orientation, truth, result.covariance)
    return float(squares.mean()) / 3.0, float(np.mean(squares < CHI2_95))


@pytest.mark.parametrize('name', FILTERS)
@pytest.mark.parametrize('acceleration', [pytest.param(3.0, marks=pytest.mark.long), 9.0])
def test_an_acceleration_that_persists_is_in_the_covariance(
    name: str, acceleration: float
) -> None:
    found = [honesty(name, *swung(seed, acceleration=acceleration)) for seed in range(3)]
    nees, share = np.mean(found, axis=0)
    assert 0.5 < nees < 2.0
    assert share > 0.9


@pytest.mark.long
@pytest.mark.parametrize('name', FILTERS)
def test_a_field_that_is_off_for_half_a_minute_is_in_the_covariance(name: str) -> None:
    found = [honesty(name, *swung(seed, field=20e-6)) for seed in range(6)]
    nees, share = np.mean(found, axis=0)
    assert nees < 2.5  # 120 to 10 000 by the assumed noises
    assert share > 0.8


@pytest.mark.parametrize('name', FILTERS)
def test_the_covariance_follows_an_acceleration_and_forgets_it(name: str) -> None:
    recording, _ = swung(7, acceleration=6.0)
    ends = recording.linear_acceleration.copy()
    ends[4500:] = swung(7)[0].linear_acceleration[4500:]
    result = run_filter(name, replace(recording, linear_acceleration=ends), preset='paper')
    sigma = np.degrees(np.sqrt(result.covariance[:, 0, 0]))
    assert sigma[4500] > 3.0 * sigma[-1]


@pytest.mark.parametrize('name', FILTERS)
def test_a_heading_is_doubted_from_the_last_field_on(name: str) -> None:
    recording, truth = swung(8)
    field = recording.magnetic_field.copy()
    field[3000:] = np.nan
    result = run_filter(name, replace(recording, magnetic_field=field), preset='paper')
    heading = result.covariance[:, 2, 2]
    assert np.all(np.diff(heading[3500::500]) > 0.0)
    squares = normalised_errors(result.orientation, truth, result.covariance)
    assert np.mean(squares[3000:] < CHI2_95) > 0.9


@pytest.mark.parametrize('name', FILTERS)
def test_at_rest_it_is_certain_after_a_minute(name: str) -> None:
    recording = rest(random_attitude(9), seed=9, seconds=SECONDS)
    result = run_filter(name, recording, preset='paper')
    inclination, heading = np.degrees(np.sqrt(result.covariance[6000, [0, 2], [0, 2]]))
    assert inclination < 1.0
    assert heading < 3.0
