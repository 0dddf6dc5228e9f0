# SPDX-License-Identifier: Apache-2.0
"""What a model has already counts as the effects of a set do."""

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.diagnose import Settings
from thermal_comp.diagnosis.evidence.effect_sets import NO_EFFECT
from thermal_comp.diagnosis.evidence.set_fit import set_of_model
from thermal_comp.diagnosis.sensor_answer import SensorAnswer
from thermal_comp.diagnosis.sensor_search import search_sensors
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.temperature_rate import TemperatureRate
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.noise.of_runs import determined_noise

from ...campaign import FIELD, WHITE, chamber, lagging, run

PERIOD = 20.0
SENSOR = 'gyroscope'
LINE = BiasTemperature()
FEW = Settings({
    name: EFFECTS[name]
    for name in ('thermal_lag', 'temperature_rate', 'bias_temperature_curvature', 'warm_up')
})  # fmt: skip
GAINS = WHITE['angular_velocity'] * np.array([1.0, -0.7, 0.9])


def _runs(law: np.ndarray) -> list:
    error = {'angular_velocity': np.multiply.outer(law, GAINS)}
    return prepare([
        run(up, seed=k, cycles=3, period=PERIOD, error=error) for k, up in enumerate(('+x', '+z'))
    ])  # fmt: skip


def _answer(runs: list, *effects: Effect) -> SensorAnswer:
    base = {SENSOR: (LINE, *effects)}
    return search_sensors(runs, base, determined_noise(runs, base)[0], FEW)[SENSOR]


def test_a_line_alone_says_nothing_and_an_effect_what_it_explains() -> None:
    die = chamber(3, PERIOD)[1]
    runs = _runs(4.0 * (lagging(die, 400.0, PERIOD) - die) / 5.0)
    lag = EFFECTS['thermal_lag'](time_constant=400.0)
    noise = determined_noise(runs, {SENSOR: (LINE, lag)})[0][SENSOR]
    design = CandidateDesign(ColumnSource(runs), SENSOR, noise, (LINE, lag))
    assert set_of_model(design, (LINE,)) is NO_EFFECT
    known = set_of_model(design, (LINE, lag))
    alone = CandidateDesign(design.source, SENSOR, noise, (LINE,))
    assert known.names == ('thermal_lag',)
    assert known.explained == pytest.approx(alone.solve([alone.term(lag)])[0], rel=0.2)


def test_a_further_effect_is_as_likely_beside_the_model_as_it_was_in_the_set() -> None:
    die = chamber(3, PERIOD)[1]
    curved = 6.0 * ((die - 20.0) / 20.0) ** 2
    runs = _runs(curved + 0.25 * (lagging(die, 400.0, PERIOD) - die) / 5.0)
    together = _answer(runs)
    curvature = EFFECTS['bias_temperature_curvature']()
    after = _answer(runs, curvature)
    assert together.probability_of(curvature.name) > 0.99
    for name in ('thermal_lag', 'warm_up'):
        before = together.probability_of(name)
        assert after.probability_of(name) == pytest.approx(before, abs=0.1), name


def test_coefficients_that_axes_share_hide_no_more_than_they_can_do() -> None:
    """Three poses tell a field of the chamber from a scale factor, whether it is known or not."""
    die = chamber(3, PERIOD)[1]
    warmth = die - 20.0
    runs = []
    for k, up in enumerate(('+x', '+y', '+z')):
        pose = np.roll(np.eye(3), k + 1, axis=0)
        turned = pose @ [6e-8, -4e-8, 3e-8] + [1.2e-3, -0.9e-3, 1.0e-3] * (pose @ FIELD)
        error = {'magnetic_field': np.multiply.outer(warmth, turned)}
        runs.append(run(up, seed=k, cycles=3, period=PERIOD, error=error))
    prepared = prepare(runs)
    names = ('fixture_hard_iron', 'scale_factor_temperature', 'warm_up')
    for known in ((), (EFFECTS['fixture_hard_iron'](),)):
        base = {'magnetometer': (LINE, *known)}
        noise = determined_noise(prepared, base)[0]
        settings = Settings({name: EFFECTS[name] for name in names})
        said = search_sensors(prepared, base, noise, settings)['magnetometer'].likeliest
        assert {*said.names, *(e.name for e in known)} == {*names[:2]}
        assert said.probability > 0.9


def test_what_the_equation_of_the_model_lacks_is_not_a_second_effect() -> None:
    """A rate that heating shows more than cooling: a law of its branch, a tenth of the rate."""
    time, die = chamber(3, PERIOD)[:2]
    rate = np.gradient(die, time) / 0.03
    runs = _runs(12.0 * rate * (1.0 + 0.1 * np.sign(rate)))
    after = _answer(runs, TemperatureRate())
    assert after.likeliest.names == ()
    assert after.likeliest.probability > 0.5
