# SPDX-License-Identifier: Apache-2.0
"""A term whose form is searched leaves what the whole least squares leave with that form."""

from __future__ import annotations

import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.design import Design, FreeTerm
from thermal_comp.linear.normal_equations import solve
from thermal_comp.noise.estimation import fit_noise

from ..campaign import run

SENSORS = ('accelerometer', 'magnetometer')
FORMS = [
    EFFECTS['thermal_lag'](time_constant=500.0),  # per axis
    EFFECTS['thermal_hysteresis'](half_widths=(2.0, 9.0)),  # several columns
    EFFECTS['bias_step'](step_time=(9000.0,)),  # per run
    EFFECTS['fixture_tilt'](),  # axes and sensors share coefficients
    EFFECTS['bias_temperature'](),  # what stands already: nothing new
]


@pytest.fixture(scope='module')
def runs() -> list[PreparedRun]:
    return prepare([run(up, seed=k, cycles=2) for k, up in enumerate(('+x', '+y'))])


@pytest.mark.parametrize('effect', FORMS, ids=lambda effect: effect.name)
def test_least_squares_are_those_of_all_columns_together(
    runs: list[PreparedRun], effect: Effect
) -> None:
    sensors = SENSORS if effect.coupled else SENSORS[:1]
    known = (EFFECTS['bias_temperature'](), EFFECTS['warm_up']())
    start = EFFECTS['bias_temperature_curvature']() if effect in known else effect
    noise = {sensor: fit_noise(runs, sensor) for sensor in sensors}
    design = Design(runs, dict.fromkeys(sensors, (*known, start)), noise)
    term = next(t for t in design.terms if t.effect == start)
    every = tuple(dict.fromkeys((*known, effect)))
    together = solve(design.with_effects(dict.fromkeys(sensors, every)).equations())
    least = FreeTerm.of(design, term).least_squares(effect)
    assert least == pytest.approx(together.chi_square[0], rel=1e-9)
