# SPDX-License-Identifier: Apache-2.0
"""Differences to thermometers that were logged, and to a board estimated from the die."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from thermal_comp.data.conditions import Conditions
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.contract import (
    CUT_ROWS,
    EXAMPLE_CAMPAIGN,
    columns_in_pieces,
    example_conditions,
)
from thermal_comp.effects.temperature_rate import SMOOTHINGS_S
from thermal_comp.effects.thermal_gradient import (
    ESTIMATED_FROM_DIE,
    SELF_HEATING_K,
    GuessedGradient,
    ThermalGradient,
)


def outside(time: np.ndarray) -> np.ndarray:
    """(n,) surroundings [°C]: half an hour at 20 °C, then a ramp of 2 K/min."""
    return 20.0 + np.clip((time - 1800.0) / 30.0, 0.0, 30.0)


@pytest.mark.parametrize(('settling', 'heating_time'), [(20.0, 150.0), (600.0, 90.0)])
def test_the_difference_to_surroundings_that_heat_a_die_is_estimated_from_it(
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
    difference = outside(time) - die
    estimated = ThermalGradient(ESTIMATED_FROM_DIE, settling, heating_time, 10.0)
    found = estimated.columns_in_hindsight(conditions)[:, 0] - SELF_HEATING_K
    np.testing.assert_allclose(found, difference, atol=0.03)
    guessed = GuessedGradient(settling, heating_time)
    np.testing.assert_array_equal(
        guessed.columns_in_hindsight(conditions), estimated.columns_in_hindsight(conditions)
    )
    live = estimated.columns(conditions)[0][:, 0] - SELF_HEATING_K
    settled = (time % 1800.0 > 100.0) & ((time < 2700.0) | (time > 2800.0))  # its filter
    np.testing.assert_allclose(live[settled], difference[settled], atol=5e-4 * settling + 0.03)


def test_a_measured_difference_has_no_time_constants() -> None:
    measured, estimated = ThermalGradient(1.0), ThermalGradient(ESTIMATED_FROM_DIE)
    assert measured.shape_parameters == {'outside': 1.0}
    assert (measured.free_shapes, measured.needs) == (0, ('device_temperature',))
    assert [p.name for p in estimated.free_parameters] == ['settling', 'heating_time']
    assert (estimated.free_shapes, estimated.needs) == (2, ())
    assert measured.variant != estimated.variant == replace(estimated, settling=9.0).variant
    assert measured.live_forms() == (measured,)
    # A file may hold any number between the bounds: the nearest form is meant.
    assert (ThermalGradient(2.4).needs, ThermalGradient(2.7).needs) == (
        ('chamber_temperature_2',),
        (),
    )
    assert ThermalGradient(2.7).columns(example_conditions())[0].shape == (
        len(example_conditions()),
        1,
    )
    assert {form.smoothing for form in estimated.live_forms()} == {*SMOOTHINGS_S}


def test_the_estimate_does_not_depend_on_where_a_stream_is_cut() -> None:
    estimated, conditions = ThermalGradient(ESTIMATED_FROM_DIE), example_conditions()
    cut = columns_in_pieces(estimated, conditions, CUT_ROWS[0])
    np.testing.assert_allclose(cut, estimated.columns(conditions)[0], atol=1e-9)


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
    forms = [c.effect for c in ThermalGradient.search_grid(campaign)]
    assert [form.outside for form in forms if form.needs] == tried
    assert any(not form.needs for form in forms) == bool(tried)  # else the board is guessed
    assert ThermalGradient.lacking(logged) == ([] if tried else ['chamber_temperature'])
