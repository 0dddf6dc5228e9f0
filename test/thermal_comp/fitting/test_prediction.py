# SPDX-License-Identifier: Apache-2.0
"""What lowers the error on held-out parts by more than chance is added, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.improvement import falls
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.empirical_term import Group
from thermal_comp.fitting.empirical import empirical_form
from thermal_comp.fitting.prediction import best_held_out, predictive_effects
from thermal_comp.noise.estimation import fit_noise

from ..campaign import WHITE, chamber, lagging, run

PERIOD = 20.0
SENSOR = 'gyroscope'
LINE = EFFECTS['bias_temperature']()


def runs_with(law: np.ndarray, axes: tuple[float, float, float]) -> list[PreparedRun]:
    """Two runs of three cycles whose gyroscope has an error of so many noise densities."""
    error = {
        'angular_velocity': np.multiply.outer(law, WHITE['angular_velocity'] * np.array(axes))
    }
    return prepare(
        [
            run(up, seed=k, cycles=3, period=PERIOD, error=error)
            for k, up in enumerate(('+x', '+z'))
        ]
    )


def predicted(runs: list[PreparedRun], **options: object) -> list[str]:
    noise = fit_noise(runs, SENSOR)
    found = predictive_effects(runs, SENSOR, [LINE], noise, EFFECTS, **options)
    return [effect.name for effect in found]


@pytest.fixture(scope='module')
def die() -> np.ndarray:
    return chamber(3, PERIOD)[1]


def test_curvature_and_lag_together_are_found_without_being_named(die: np.ndarray) -> None:
    law = ((die - 20.0) / 10.0) ** 2 + (lagging(die, 400.0, PERIOD) - die) / 2.0
    curve, lag = sorted(predicted(runs_with(law, (4.0, -3.0, 3.5))))
    assert curve == 'bias_temperature_curvature'
    assert lag in {'thermal_lag', 'thermal_lag_two_stage'}


def test_two_effects_are_added_where_no_single_one_will_do() -> None:
    """One sweep in five blocks: curvature without the lags spoils the block it has not seen."""
    die = chamber(1, PERIOD)[1]
    law = ((die - 20.0) / 10.0) ** 2 + 2.0 * (
        lagging(die, 300.0, PERIOD) + 0.5 * lagging(die, 2500.0, PERIOD) - 1.5 * die
    )
    error = {'angular_velocity': np.multiply.outer(law, WHITE['angular_velocity'] * np.ones(3))}
    sweep = prepare([run('+z', seed=3, cycles=1, period=PERIOD, error=error)])
    assert len(predicted(sweep)) >= 2


@pytest.mark.long
@pytest.mark.parametrize('seed', [0, 5])
def test_a_random_walk_in_one_sweep_is_no_effect_of_temperature(seed: int) -> None:
    """Smooth in time, it passed for a lag or an empirical term between near neighbours."""
    walk = np.cumsum(np.random.default_rng(seed).standard_normal(len(chamber(1)[1])))
    law = np.multiply.outer(10.0 * walk / walk.std(), WHITE['angular_velocity'] * np.ones(3))
    sweep = prepare([run('+z', seed=3, cycles=1, error={'angular_velocity': law})])
    assert not predicted(sweep)
    assert empirical_form(sweep, SENSOR, [LINE], fit_noise(sweep, SENSOR)) is None


def test_noise_alone_gets_nothing() -> None:
    runs = prepare([run('+z', seed=k, cycles=3, period=PERIOD) for k in (20, 21)])
    assert predicted(runs) == []
    assert empirical_form(runs, SENSOR, [LINE], fit_noise(runs, SENSOR)) is None


def test_a_temperature_that_turns_no_play_leaves_nothing_of_it() -> None:
    """Plays that never turn are a line in temperature: what is left of them is rounding."""
    still = run('+z', seed=3, cycles=1, period=1.0).rows(slice(0, 700))
    noise = 0.02 * np.random.default_rng(0).standard_normal(700)
    settling = np.multiply.outer(
        np.exp(-still.time / 120.0), WHITE['angular_velocity'] * np.array([0.0, 1e3, -3e2])
    )
    runs = prepare(
        [
            replace(
                still,
                temperature=47.5 + 0.15 * np.sin(still.time / 60.0) + noise,
                angular_velocity=still.angular_velocity + settling,
            )
        ]
    )
    form = empirical_form(runs, SENSOR, [LINE], fit_noise(runs, SENSOR))
    assert form is not None
    widths = np.array(form.deviations).reshape(-1, 3)
    assert widths[Group.DECAYS, 1] > 0.0
    assert not widths[Group.BRANCHES].any()


def test_a_set_that_is_given_is_tried_whole(die: np.ndarray) -> None:
    runs = runs_with((lagging(die, 400.0, PERIOD) - die) / 2.0, (4.0, -3.0, 3.5))
    rate = {n: EFFECTS[n] for n in ('thermal_lag', 'temperature_rate')}
    noise = fit_noise(runs, SENSOR)
    alone = predictive_effects(runs, SENSOR, [LINE], noise, {}, [('thermal_lag',)])
    assert alone == ()
    (lag,) = predictive_effects(runs, SENSOR, [LINE], noise, rate, [('thermal_lag',)])
    assert lag.shape_parameters['time_constant'] == pytest.approx(400.0, rel=0.4)


def test_of_two_shapes_the_one_that_holds_on_unseen_parts_is_taken(die: np.ndarray) -> None:
    runs = runs_with((lagging(die, 400.0, PERIOD) - die) / 2.0, (4.0, -3.0, 3.5))
    near, far = ((LINE, EFFECTS['thermal_lag'](tau)) for tau in (420.0, 3000.0))
    noise = fit_noise(runs, SENSOR)
    assert best_held_out(runs, SENSOR, [far, near], noise) == near
    assert best_held_out(runs, SENSOR, [near, near], noise) is near


def test_an_axis_that_feels_nothing_keeps_to_the_line(die: np.ndarray) -> None:
    runs = runs_with(np.abs(die - 32.0) / 10.0, (4.0, 0.0, 0.0))
    form = empirical_form(runs, SENSOR, [LINE], fit_noise(runs, SENSOR))
    assert form is not None
    widths = form.coefficient_deviations()
    assert widths[:, 0].any()
    assert not widths[:, 1:].any()


def test_errors_fall_only_by_more_than_chance_and_where_it_is_worth_it() -> None:
    one = 9.0 * np.ones(6)
    assert falls(one, 0.5 * one * np.array([1.0, 1.1, 0.9, 1.0, 1.2, 0.8]), 1.0)
    assert not falls(one, one * np.array([0.1, 0.1, 1.3, 1.4, 1.2, 1.1]), 1.0), 'on two parts'
    assert not falls(one, 0.95 * one, 1.0), 'by 2.5 % of the rms'
    assert not falls(one[:2], 0.1 * one[:2], 1.0), 'two parts are too few'
    assert not falls(one, 0.5 * one, 10.0), 'what is left is noise already'
