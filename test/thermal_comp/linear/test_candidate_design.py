# SPDX-License-Identifier: Apache-2.0
"""A diagnosis sees temperature as smooth as the thermometer's noise asks for, and no smoother."""

import numpy as np
import pytest
from thermal_comp.data.conditions import Conditions
from thermal_comp.effects import EFFECTS
from thermal_comp.linear.candidate_design import NARROWEST_S, WIDEST_S, smoothing_width

STEP = 5.0
TIME = np.arange(4000) * STEP


def ramps() -> np.ndarray:
    """(n,) °C up and down at 2 K/min with dwells of half an hour."""
    rate = 2.0 / 60.0 * np.sign(np.sin(2.0 * np.pi * TIME / 7200.0))
    dwell = np.abs(np.sin(2.0 * np.pi * TIME / 7200.0)) < np.sin(np.pi / 4.0)
    return 20.0 + np.cumsum(np.where(dwell, 0.0, rate)) * STEP


def noisy(noise: float) -> np.ndarray:
    return ramps() + noise * np.random.default_rng(3).standard_normal(len(TIME))


def at_rest() -> Conditions:
    still = np.zeros((len(TIME), 3))
    return Conditions(TIME, ramps(), still, still, still)


def test_noisier_thermometers_are_smoothed_wider() -> None:
    widths = [smoothing_width(noisy(noise), STEP) for noise in (0.005, 0.023, 0.06)]
    assert widths == sorted(widths)
    assert widths[1] == pytest.approx(20.0, rel=0.05)
    assert smoothing_width(ramps(), STEP) == NARROWEST_S
    assert smoothing_width(noisy(5.0), STEP) == WIDEST_S


def test_ramps_are_not_taken_for_noise() -> None:
    flat = 20.0 + 0.023 * np.random.default_rng(3).standard_normal(len(TIME))
    assert smoothing_width(noisy(0.023), STEP) == pytest.approx(
        smoothing_width(flat, STEP), rel=0.02
    )


def test_in_hindsight_a_rate_changes_at_the_corner_itself() -> None:
    conditions = at_rest()
    effect = EFFECTS['temperature_rate']()
    seen, live = effect.columns_in_hindsight(conditions)[:, 0], effect.columns(conditions)[0][:, 0]
    true = np.diff(ramps(), prepend=ramps()[0]) / STEP
    assert np.abs(seen - true).mean() < 0.3 * np.abs(live - true).mean()


def test_other_effects_look_the_same_in_hindsight() -> None:
    conditions = at_rest()
    effect = EFFECTS['thermal_lag']()
    np.testing.assert_array_equal(
        effect.columns_in_hindsight(conditions), effect.columns(conditions)[0]
    )
