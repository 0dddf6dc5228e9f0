# SPDX-License-Identifier: Apache-2.0
"""A sensor whose counts are coarser than its noise lacks no effect: rounding is allowed for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.diagnosis.diagnose import diagnose

from imu_recording import ImuRecording

from ..campaign import WHITE, run


@pytest.mark.parametrize('seed', [3, pytest.param(5, marks=pytest.mark.long)])
def test_rounding_to_counts_of_four_times_the_noise_is_no_effect(seed: int) -> None:
    still = run(cycles=2, seed=seed, period=1.0)
    count = 4.0 * WHITE['angular_velocity']
    rounded = count * np.round(still.angular_velocity / count)
    diagnosis = diagnose([replace(still, angular_velocity=rounded)])
    likeliest = {e.sensor: e for e in reversed(diagnosis.explanations)}['gyroscope']
    assert likeliest.names == ()
    assert likeliest.probability > 0.5


@pytest.mark.parametrize('ratio', [3.0, 4.0])
def test_rounding_is_allowed_for_where_many_samples_are_averaged(ratio: float) -> None:
    """Means of a second hide the counts of their samples, and show what rounding did to them."""
    time = np.arange(0.0, 1500.0, 0.04)
    die = 22.0 + 14.0 * (1.0 - np.exp(-time / 240.0)) + 2.0 * np.sin(2.0 * np.pi * time / 500.0)
    count = ratio * 2e-3
    rate = np.outer(die - 20.0, [1.0, -0.8, 0.6]) * 1e-3
    rate += 2e-3 * np.random.default_rng(4).standard_normal(rate.shape)
    unknown = np.full_like(rate, np.nan)
    recording = ImuRecording(
        stamp=np.round(time * 1e9).astype(np.int64),
        temperature=die + 0.01 * np.random.default_rng(5).standard_normal(len(time)),
        linear_acceleration=unknown,
        angular_velocity=count * np.round(rate / count),
        magnetic_field=unknown,
        device='board',
        up_axis='+z',
    )
    (likeliest, *_) = diagnose([recording]).explanations
    assert likeliest.names == ()
    assert likeliest.probability > 0.5
