# SPDX-License-Identifier: Apache-2.0
"""Smoothing knows each row from both sides: no run-in at the start, and less error everywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from orientation_filters.errors import attitude_errors, normalised_errors
from orientation_filters.filters import FILTERS, run_filter
from orientation_filters.smoothing import reversed_in_time, run_smoother

from .recordings import moving, random_attitude, rest


@pytest.mark.parametrize('name', FILTERS)
def test_smoothing_takes_the_run_in_away(name: str) -> None:
    truth = random_attitude(3)
    recording = rest(truth, seed=3, seconds=30.0, bias=np.radians([0.5, -0.4, 0.3]))
    still = np.broadcast_to(truth, (len(recording), 4))
    forward = run_filter(name, recording, preset='robust')
    smoothed = run_smoother(name, recording)
    early = np.arange(len(recording)) < 300
    errors = [
        attitude_errors(r.orientation, still).rms(early)['total'] for r in (forward, smoothed)
    ]
    assert errors[1] < 0.5 * errors[0]
    assert np.degrees(np.abs(smoothed.bias[1500] - forward.bias[-1])).max() < 0.1
    assert np.median(normalised_errors(smoothed.orientation, still, smoothed.covariance)) < 7.8


@pytest.mark.parametrize('name', FILTERS)
def test_smoothing_is_the_same_forward_and_backward(name: str) -> None:
    recording = moving(5, seconds=20.0)
    one = run_smoother(name, recording)
    other = run_smoother(name, reversed_in_time(recording))
    apart = attitude_errors(one.orientation, other.orientation[::-1]).total
    assert np.nanmax(apart) < 5e-3  # the order of large rotations
    assert np.nanmax(np.abs(one.covariance - other.covariance[::-1])) < 1e-9


@pytest.mark.parametrize('name', FILTERS)
def test_rows_known_from_one_side_only_keep_that_attitude(name: str) -> None:
    recording = rest(random_attitude(4), seed=4, seconds=10.0)
    force = recording.linear_acceleration.copy()
    force[:200] = np.nan
    broken = replace(recording, linear_acceleration=force)
    forward, smoothed = run_filter(name, broken, preset='robust'), run_smoother(name, broken)
    assert np.isnan(forward.orientation[100]).all()
    assert np.isfinite(smoothed.orientation[100]).all()
    assert np.isfinite(smoothed.covariance[100]).all()
