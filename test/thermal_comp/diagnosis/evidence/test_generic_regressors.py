# SPDX-License-Identifier: Apache-2.0
"""A residual that follows one variable is explained best by the regressor of that variable."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.data.spectral_lines import spectral_lines
from thermal_comp.diagnosis.evidence.effect_sets import NOT_IN_CATALOGUE
from thermal_comp.diagnosis.evidence.generic_regressors import (
    BAND_PIECES,
    generic_regressors,
    lost_channels,
)
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.diagnosis.evidence.posterior import explanations
from thermal_comp.diagnosis.evidence.set_search import likeliest_sets
from thermal_comp.diagnosis.sensor_search import Settings, search_sensors
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.noise.estimation import fit_noise
from thermal_comp.noise.of_runs import determined_noise

from ...campaign import WHITE, chamber, run

TIME, DIE, _, CYCLE = chamber(3, 20.0)
SIZE = 20.0 * WHITE['angular_velocity'] * np.array([1.0, -0.6, 0.8])
LAWS = {
    'temperature': np.abs(np.abs((DIE - 20.0) / 10.0) - 1.5),
    'rate': np.gradient(DIE, TIME) * 100.0,
    'cycle': (CYCLE == 2).astype(float),
}


@pytest.mark.parametrize('variable', LAWS)
def test_the_regressor_of_the_variable_explains_most(variable: str) -> None:
    error = {'angular_velocity': np.multiply.outer(LAWS[variable], SIZE)}
    recordings = [
        run(up, seed=k, cycles=3, period=20.0, error=error) for k, up in enumerate(('+x', '+z'))
    ]
    runs = prepare(recordings)
    base = [BiasTemperature()]
    noise = fit_noise(prepare([run(seed=3, cycles=3, period=20.0)]), 'gyroscope')
    design = CandidateDesign(ColumnSource(runs), 'gyroscope', noise, base)
    hypotheses = SensorHypotheses(design, {})
    likeliest = explanations(hypotheses, likeliest_sets(hypotheses))[0][0]
    assert likeliest.names == (NOT_IN_CATALOGUE,)
    assert likeliest.depends_on == variable


def test_channels_have_a_regressor_only_where_they_were_logged() -> None:
    runs = prepare([run(seed=1, cycles=3, period=20.0)])
    noise = fit_noise(runs, 'gyroscope')
    design = CandidateDesign(ColumnSource(runs), 'gyroscope', noise, [BiasTemperature()])
    asked = {r.depends_on for r in generic_regressors(design, EFFECTS) if not r.unlogged}
    assert {'temperature', 'branch', 'rate', 'time', 'orientation', 'cycle'} == asked


def test_a_line_is_one_of_as_many_bands_as_were_looked_through() -> None:
    wave = np.multiply.outer(np.cos(2.0 * np.pi * TIME / 130.0), SIZE)
    runs = prepare([run(seed=1, cycles=3, period=20.0, error={'angular_velocity': wave})])
    noise = fit_noise(runs, 'gyroscope')
    lines = {'gyroscope': spectral_lines(runs, 'gyroscope')}
    design = CandidateDesign(ColumnSource(runs, lines), 'gyroscope', noise, [BiasTemperature()])
    regressors = generic_regressors(design, EFFECTS)
    assert {r.suspect for r in regressors if r.depends_on == 'frequency'} == {'chamber'}
    places = {r.depends_on: r.places for r in regressors}
    assert places.pop('frequency') == pytest.approx(np.ptp(TIME) / 40.0 / BAND_PIECES, rel=0.01)
    assert set(places.values()) == {1.0}


def test_a_line_that_comes_and_goes_by_all_of_its_amplitude_keeps_its_name() -> None:
    """As that of a heater that was not logged does."""
    on = np.sin(2.0 * np.pi * TIME / 9000.0) > 0.7
    wave = np.multiply.outer(on * np.cos(2.0 * np.pi * TIME / 130.0), SIZE)
    recordings = [
        run(up, seed=k, cycles=3, period=20.0, error={'angular_velocity': wave})
        for k, up in enumerate(('+x', '+z'))
    ]
    runs, base = prepare(recordings), {'gyroscope': (BiasTemperature(),)}
    settings = Settings({'mains_alias': EFFECTS['mains_alias']})
    answer = search_sensors(runs, base, determined_noise(runs, base)[0], settings)['gyroscope']
    assert answer.likeliest.names == ('mains_alias',)


def test_what_follows_one_machine_of_a_chamber_may_be_another_that_was_not_logged() -> None:
    runs = prepare([
        replace(run(seed=1, cycles=3, period=20.0), compressor=(DIE < 10.0).astype(float))
    ])  # fmt: skip
    noise = fit_noise(runs, 'magnetometer')
    design = CandidateDesign(ColumnSource(runs), 'magnetometer', noise, [BiasTemperature()])
    suspects = {r.depends_on: r.suspect for r in generic_regressors(design, EFFECTS)}
    assert suspects['compressor'] == 'heater'


def test_a_lost_channel_of_a_user_s_effect_is_suspected_on_its_sensor() -> None:
    class Barometric(BiasTemperature):
        sensors = ('gyroscope',)
        channels = ('pressure',)

    runs = prepare([run(seed=1, cycles=3, period=20.0)])
    lost = {}
    for sensor in ('gyroscope', 'accelerometer'):
        noise = fit_noise(runs, sensor)
        design = CandidateDesign(ColumnSource(runs), sensor, noise, [BiasTemperature()])
        known = lost_channels(design, EFFECTS)
        lost[sensor] = set(lost_channels(design, {**EFFECTS, 'barometric': Barometric})) - {*known}
    assert lost == {'gyroscope': {'pressure'}, 'accelerometer': set()}
    bare = run(seed=1, cycles=3, period=20.0)
    still = np.zeros(len(bare.stamp))
    every = dict.fromkeys(('heater', 'compressor', 'supply_voltage', 'humidity'), still)
    [logged] = prepare([replace(bare, **every, vibration=np.zeros((len(still), 3)))])
    noise = fit_noise([logged], 'gyroscope')
    design = CandidateDesign(ColumnSource([logged]), 'gyroscope', noise, [BiasTemperature()])
    assert SensorHypotheses(design, {}).lost_over_time == ''
    assert SensorHypotheses(design, {'barometric': Barometric}).lost_over_time == 'pressure'


@pytest.mark.parametrize('channel', ['fan', pytest.param('pressure', marks=pytest.mark.long)])
def test_what_follows_a_logged_channel_without_an_effect_is_said_to_follow_it(
    channel: str,
) -> None:
    course = 1.0 + 0.1 * np.cumsum(np.random.default_rng(4).normal(size=len(TIME))) / 40.0
    error = {'linear_acceleration': np.outer(course - 1.0, [2e-2, -1e-2, 1.5e-2])}
    logged: dict[str, Any] = {channel: course}
    runs = prepare([
        replace(run(up, seed=k, cycles=3, period=20.0, error=error), **logged)
        for k, up in enumerate(('+x', '+y'))
    ])  # fmt: skip
    base = {'accelerometer': (BiasTemperature(),)}
    noise = determined_noise(runs, base)[0]
    answer = search_sensors(runs, base, noise, Settings(EFFECTS))['accelerometer']
    assert answer.likeliest.names == (NOT_IN_CATALOGUE,)
    assert answer.likeliest.depends_on == channel


def test_a_slope_that_ages_from_pose_to_pose_is_no_misalignment() -> None:
    pause, recordings = 30_000.0, []
    for k, up in enumerate(('+x', '+y', '+z')):
        age = (TIME + k * pause) / pause
        error = {'linear_acceleration': np.outer(age * (DIE - 20.0), [3e-4, -2e-4, 2.5e-4])}
        one = run(up, seed=k, cycles=3, period=20.0, error=error)
        recordings.append(replace(one, stamp=one.stamp + int(k * pause * 1e9)))
    runs = prepare(recordings)
    base = {'accelerometer': (BiasTemperature(),)}
    settings = Settings({'misalignment_temperature': EFFECTS['misalignment_temperature']})
    answer = search_sensors(runs, base, determined_noise(runs, base)[0], settings)['accelerometer']
    assert (answer.likeliest.names, answer.likeliest.depends_on) == ((NOT_IN_CATALOGUE,), 'time')
