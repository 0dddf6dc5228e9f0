# SPDX-License-Identifier: Apache-2.0
"""Shape parameters by search: on scales that lead there and back, to the value that was put in."""

from __future__ import annotations

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.shape_search import (
    bound_notes,
    refine_shapes,
    shape_scales,
    shape_values,
    with_shape,
)
from thermal_comp.linear.design import Design
from thermal_comp.noise.estimation import fit_noise

from ..campaign import chamber, lagging, run

HOUR = 3600.0


@pytest.mark.parametrize(
    'effect',
    [
        EFFECTS['thermal_lag'](time_constant=77.0),
        EFFECTS['thermal_hysteresis'](half_widths=(2.0, 9.0)),
        EFFECTS['bias_temperature'](),
    ],
    ids=lambda effect: effect.name,
)
def test_values_come_back_from_their_scales(effect: Effect) -> None:
    scales = shape_scales(effect, HOUR)
    back = with_shape(effect, scales, shape_values(effect, scales))
    for before, after in zip(vars(effect).values(), vars(back).values(), strict=True):
        assert after == pytest.approx(before, rel=1e-12)


def test_times_are_searched_in_ratios_and_no_longer_than_the_run() -> None:
    (scale,) = shape_scales(EFFECTS['thermal_lag'](), 2000.0)
    values = np.array([scale.back(v) for v in scale.grid()])
    assert values[[0, -1]] == pytest.approx([10.0, 2000.0])
    assert values[1:] / values[:-1] == pytest.approx(200.0 ** (1.0 / (len(values) - 1)))
    assert scale.back(scale.forward(1e6)) == pytest.approx(2000.0)


def test_a_run_of_a_minute_is_searched_for_times_of_a_second() -> None:
    (scale,) = shape_scales(EFFECTS['thermal_lag'](), 60.0)
    assert (scale.low, scale.high) == pytest.approx((0.6, 60.0))


def design(true: float, start: float) -> Design:
    """Return a gyroscope with a lag of `true` seconds, fitted with one of `start`."""
    _, die, *_ = chamber(1)
    error = 1e-3 * (lagging(die, true, 5.0) - die)[:, None] * np.array([1.0, -0.5, 0.7])
    runs = prepare([run(cycles=1, error={'angular_velocity': error})])
    effects = EFFECTS['bias_temperature'](), EFFECTS['thermal_lag'](time_constant=start)
    return Design(runs, {'gyroscope': effects}, {'gyroscope': fit_noise(runs, 'gyroscope')})


def test_the_lag_is_found_from_afar_and_one_at_its_limit_is_said() -> None:
    found = refine_shapes(design(true=300.0, start=20.0))
    assert found.effects['gyroscope'][1].time_constant == pytest.approx(300.0, rel=0.02)
    assert found.effects['gyroscope'][0] == EFFECTS['bias_temperature']()
    assert bound_notes(found) == []
    (note,) = bound_notes(design(true=300.0, start=10.0))
    assert note.startswith('gyroscope: thermal lag: time constant ends at 10, the limit of')


def test_two_stages_do_not_meet_where_one_body_follows_another() -> None:
    _, die, *_ = chamber(1)
    behind = lagging(lagging(die, 400.0, 5.0), 400.0, 5.0) - die
    error = 1e-3 * behind[:, None] * np.array([1.0, -0.5, 0.7])
    runs = prepare([run(cycles=1, error={'angular_velocity': error})])
    effects = EFFECTS['bias_temperature'](), EFFECTS['thermal_lag_two_stage']()
    noise = {'gyroscope': fit_noise(runs, 'gyroscope')}
    found = refine_shapes(Design(runs, {'gyroscope': effects}, noise))
    lag = found.effects['gyroscope'][1]
    assert lag.stages_are_apart
    assert not with_shape(lag, shape_scales(lag, HOUR), np.log([400.0, 401.0])).stages_are_apart
    (note,) = bound_notes(found)
    assert note.startswith('gyroscope: thermal lag two stage: its stages end at ')
    assert 'one body may follow another' in note
