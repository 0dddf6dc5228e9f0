# SPDX-License-Identifier: Apache-2.0
"""Differences to thermometers that were logged, and what a die tells of one that was not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from thermal_comp.data.conditions import Conditions
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.contract import EXAMPLE_CAMPAIGN
from thermal_comp.effects.thermal_gradient import (
    SELF_HEATING_K,
    GuessedGradient,
    ThermalGradient,
)


def outside(time: np.ndarray) -> np.ndarray:
    """(n,) surroundings [°C]: half an hour at 20 °C, then a ramp of 2 K/min."""
    return 20.0 + np.clip((time - 1800.0) / 30.0, 0.0, 30.0)


@pytest.mark.parametrize(('settling', 'heating_time'), [(20.0, 150.0), (600.0, 90.0)])
def test_the_guess_is_the_difference_to_surroundings_that_heat_a_die(
    settling: float, heating_time: float
) -> None:
    time = np.arange(0.0, 4000.0, 1.0)
    followed = solve_ivp(
        lambda t, die: (outside(t) - die) / settling,
        (0.0, time[-1]),
        [20.0],
        t_eval=time,
        max_step=1.0,
    ).y[0]
    die = followed + SELF_HEATING_K * -np.expm1(-time / heating_time)
    still = np.zeros((len(time), 3))
    conditions = Conditions(time, die, still, still, still)
    guessed = GuessedGradient(settling, heating_time).columns_in_hindsight(conditions)[:, 0]
    difference = outside(time) - die
    np.testing.assert_allclose(settling * guessed - SELF_HEATING_K, difference, atol=0.03)


def test_the_guess_is_no_effect_that_a_model_can_hold() -> None:
    assert GuessedGradient.name not in EFFECTS
    assert EFFECTS['thermal_gradient'].guess() is GuessedGradient
    assert GuessedGradient.guess() is None


@pytest.mark.parametrize(
    ('logged', 'tried'),
    [
        ({'chamber_temperature'}, [0.0]),
        ({'device_temperature', 'humidity'}, [1.0]),
        ({'chamber_temperature', 'chamber_temperature_2', 'device_temperature'}, [0.0, 1.0, 2.0]),
        ({'humidity'}, []),
    ],
)
def test_every_thermometer_that_was_logged_is_tried(logged: set[str], tried: list[float]) -> None:
    campaign = replace(EXAMPLE_CAMPAIGN, channels=frozenset(logged))
    assert [c.effect.outside for c in ThermalGradient.search_grid(campaign)] == tried
    assert ThermalGradient.lacking(logged) == ([] if tried else ['chamber_temperature'])
