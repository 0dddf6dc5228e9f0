# SPDX-License-Identifier: Apache-2.0
"""Means and variances of rows; vibration is the variance within whole seconds."""

import itertools

import numpy as np
import pytest
from thermal_comp.data.binning import (
    LEAST_SAMPLES,
    VibrationState,
    bin_means,
    bin_variances,
    update_vibration,
    vibration_of,
)

SECOND = 1_000_000_000


def test_a_row_with_a_hole_counts_in_no_mean_and_no_variance() -> None:
    values = np.random.default_rng(5).normal(size=(40, 3))
    values[[3, 17], 1] = np.nan
    starts = np.array([0, 7, 20, 40])
    mean, count = bin_means(values, starts)
    variance = bin_variances(values, starts, mean)
    for k, (start, stop) in enumerate(itertools.pairwise(starts)):
        rows = values[start:stop]
        rows = rows[np.isfinite(rows).all(axis=1)]
        assert count[k] == len(rows)
        np.testing.assert_allclose(mean[k], rows.mean(axis=0))
        np.testing.assert_allclose(variance[k], rows.var(axis=0, ddof=1))


def sine(rate: int) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps and acceleration of a shaker of 7 Hz along x, for four seconds."""
    stamp = (np.arange(4 * rate) * (SECOND // rate)).astype(np.int64)
    acceleration = np.zeros((len(stamp), 3))
    acceleration[:, 0] = 2.0 * np.sin(2.0 * np.pi * 7.0 * stamp * 1e-9)
    return stamp, acceleration


def test_vibration_of_a_sine_is_half_its_amplitude_squared() -> None:
    stamp, acceleration = sine(100)
    vibration = vibration_of(stamp, acceleration, 0)
    assert np.isnan(vibration[:100]).all()  # no second is full yet
    np.testing.assert_allclose(vibration[100:, 0], 2.0, rtol=0.02)
    np.testing.assert_allclose(vibration[100:, 1:], 0.0)


def test_too_few_samples_in_a_second_tell_no_vibration() -> None:
    stamp, acceleration = sine(LEAST_SAMPLES - 5)
    assert np.isnan(vibration_of(stamp, acceleration, 0)).all()


@pytest.mark.parametrize('rate', [100, LEAST_SAMPLES - 5])
def test_sample_by_sample_it_is_the_same(rate: int) -> None:
    stamp, acceleration = sine(rate)
    state, live = VibrationState(), []
    for at, sample in zip(stamp.tolist(), acceleration.tolist(), strict=True):
        state = update_vibration(state, at, tuple(sample), 0)
        live.append(state.variance)
    np.testing.assert_array_equal(live, vibration_of(stamp, acceleration, 0))
