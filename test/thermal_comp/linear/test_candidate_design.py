# SPDX-License-Identifier: Apache-2.0
"""What effects look like in hindsight."""

import numpy as np
from thermal_comp.data.conditions import Conditions
from thermal_comp.effects import EFFECTS

STEP = 5.0
TIME = np.arange(4000) * STEP


def ramps() -> np.ndarray:
    """(n,) °C up and down at 2 K/min with dwells of half an hour."""
    rate = 2.0 / 60.0 * np.sign(np.sin(2.0 * np.pi * TIME / 7200.0))
    dwell = np.abs(np.sin(2.0 * np.pi * TIME / 7200.0)) < np.sin(np.pi / 4.0)
    return 20.0 + np.cumsum(np.where(dwell, 0.0, rate)) * STEP


def at_rest() -> Conditions:
    still = np.zeros((len(TIME), 3))
    return Conditions(TIME, ramps(), still, still, still)


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
