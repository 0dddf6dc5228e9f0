# SPDX-License-Identifier: Apache-2.0
"""Rows that are stuck or at a rail, told from chance repeats and from coarse counts."""

import numpy as np
import pytest
from thermal_comp.data.defective_rows import LEAST_STUCK_ROWS, rail_rows, stuck_rows

PERIOD = 2.0


def quantised(noise: float, *, seed: int) -> np.ndarray:
    """Return (20000, 3) values in quantisation steps, of white noise of that many steps."""
    return np.round(np.random.default_rng(seed).normal(0.3, noise, (20_000, 3)))


@pytest.mark.parametrize('noise', [0.35, 0.6, 1.0, 3.0])
def test_chance_repeats_of_a_quantised_triad_are_not_stuck(noise: float) -> None:
    for seed in range(5):
        assert not stuck_rows(quantised(noise, seed=seed), PERIOD).any()


def test_chance_alone_makes_runs_as_long_as_the_least() -> None:
    values = quantised(0.6, seed=1)
    same = (values[1:] == values[:-1]).all(axis=1)
    runs = np.lib.stride_tricks.sliding_window_view(same, LEAST_STUCK_ROWS).all(axis=1)
    assert runs.any()


@pytest.mark.parametrize('noise', [0.35, 0.6, 3.0])
def test_a_sensor_stuck_for_minutes_is_found_to_the_row(noise: float) -> None:
    values = quantised(noise, seed=2)
    values[5000:5091] = values[5000]
    values[4999] = values[5091] = values[5000] + 5.0
    stuck = np.flatnonzero(stuck_rows(values, PERIOD))
    np.testing.assert_array_equal(stuck, np.arange(5001, 5091))


def ramped_counts(noise: float) -> np.ndarray:
    """Return (20000, 3) counts of dwells and ramps, of white noise of that many counts."""
    rng = np.random.default_rng(6)
    ramps = np.interp(np.arange(20_000) % 5000, [0, 1500, 2500, 4000, 5000], [0, 0, 9, 9, 0])
    return np.round(ramps[:, None] * [1.0, -0.7, 0.4] + 0.1 + rng.normal(0.0, noise, (20_000, 3)))


def test_counts_much_coarser_than_the_noise_stand_still_in_dwells() -> None:
    assert not stuck_rows(ramped_counts(0.12), PERIOD).any()


def test_a_sensor_of_coarse_counts_that_was_stuck_leaves_by_more_than_one() -> None:
    values = ramped_counts(0.12)
    values[1600:2400] = values[1600]
    assert stuck_rows(values, PERIOD)[1601:2400].all()


def test_the_least_run_is_enough_where_nothing_repeats_by_chance() -> None:
    values = np.random.default_rng(3).normal(size=(20_000, 3))
    values[700 : 701 + LEAST_STUCK_ROWS] = values[700]
    assert stuck_rows(values, PERIOD).sum() == LEAST_STUCK_ROWS


def test_values_without_noise_are_not_stuck_where_nothing_changes() -> None:
    ramp = np.clip(np.linspace(-1.0, 2.0, 3000), 0.0, 1.0)[:, None] * np.array([1.0, -2.0, 0.5])
    assert not stuck_rows(ramp, PERIOD).any()


def test_counts_coarser_than_the_noise_dwell_at_the_ends_of_a_sweep_and_are_no_rail() -> None:
    sweep = np.concatenate([np.zeros(600), np.linspace(0.0, 12.0, 900), np.full(600, 12.0)])
    noise = np.random.default_rng(3).normal(size=(len(sweep), 3))
    assert not rail_rows(np.round(sweep[:, None] + 0.1 * noise)).any()
    fine = sweep[:, None] + 0.1 * noise
    assert rail_rows(np.minimum(np.round(fine, 2), 11.9)).any()
