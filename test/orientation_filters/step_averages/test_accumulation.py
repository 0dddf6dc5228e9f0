# SPDX-License-Identifier: Apache-2.0
"""The attitude carried on from sample to sample, beside motion known as a closed formula."""

from __future__ import annotations

import numpy as np
import pytest
from imu_recording.recording import FloatArray
from orientation_filters.rotation.arrays import (
    conjugate,
    from_rotation_vector,
    multiply,
    to_rotation_vector,
)
from orientation_filters.rotation.scalars import ZERO
from orientation_filters.sample_checks import NO_FIELD, CheckedSample
from orientation_filters.step_averages.accumulation import integrate, no_averages

CONE_RAD, TURNS_HZ = 0.3, 1.5


def cone(time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return attitudes xyzw and body rates of an axis that walks on a cone while turning."""
    phase = 2.0 * np.pi * TURNS_HZ * time
    spin = from_rotation_vector(phase[:, None] * [0.0, 0.0, 1.0])
    tilt = from_rotation_vector(np.array([[CONE_RAD, 0.0, 0.0]]))
    attitude = multiply(multiply(spin, tilt), conjugate(spin))
    speed = 2.0 * np.pi * TURNS_HZ
    across = speed * np.sin(CONE_RAD)
    rate = np.column_stack(
        [
            -across * np.sin(phase),
            across * np.cos(phase),
            np.full_like(phase, speed * (np.cos(CONE_RAD) - 1.0)),
        ]
    )
    return attitude, rate


def drift_deg(time: FloatArray, noise: FloatArray | float = 0.0) -> float:
    """Return by how much the last attitude is off [deg]."""
    attitude, rate = cone(time)
    rate = rate + noise
    q, averages = tuple(attitude[0].tolist()), no_averages()
    averages = averages._replace(rate=tuple(rate[0].tolist()))
    for dt, w in zip(np.diff(time), rate[1:].tolist(), strict=True):
        seen = CheckedSample(0, tuple(w), ZERO, NO_FIELD, False, False, float(dt), float(dt))
        q = integrate(q, ZERO, averages, seen)
        change = tuple((np.array(w) - averages.rate).tolist())
        averages = averages._replace(rate=tuple(w), change=change, interval=float(dt))
    apart = multiply(np.array(q), conjugate(attitude[-1]))
    return float(np.degrees(np.linalg.norm(to_rotation_vector(apart))))


def test_the_rates_are_those_of_the_attitudes() -> None:
    time = np.linspace(0.0, 1.0, 100_001)
    assert drift_deg(time[:2_000]) < 1e-6


def test_a_cone_at_a_hundred_hertz_leaves_no_drift() -> None:
    assert drift_deg(np.arange(1_000) / 100.0) < 0.02, 'the mean of two rates drifts by 0.7°'


@pytest.mark.parametrize('seed', [0, 5])
def test_noise_over_a_short_interval_bends_no_long_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.sort(np.arange(1_000) / 100.0 + rng.uniform(-0.009, 0.009, 1_000))
    noise = 1e-3 * rng.normal(size=(len(time), 3))
    assert drift_deg(time, noise) < 0.7, 'the mean of two rates drifts by 1.5°'
