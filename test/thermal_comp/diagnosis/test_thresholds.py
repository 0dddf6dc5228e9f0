# SPDX-License-Identifier: Apache-2.0
"""Thresholds from noise alone are those the search itself would need."""

import numpy as np
import pytest
from thermal_comp.data.preparation import PreparedRun, prepare
from thermal_comp.diagnosis.candidates import families
from thermal_comp.diagnosis.search import Search
from thermal_comp.diagnosis.thresholds import (
    calibrated_thresholds,
    reached_without_effect,
    tail_quantile,
    threshold_of,
)
from thermal_comp.effects import EFFECTS
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.estimation import fit_noise, fit_noise_to_values
from thermal_comp.noise.process import draw_noise

from ..campaign import run

LINE = (EFFECTS['bias_temperature'](),)


@pytest.fixture(scope='module')
def runs() -> list[PreparedRun]:
    return prepare([run(up, seed=k, cycles=3) for k, up in enumerate(('+x', '+z'))])


def test_draws_are_rated_as_the_search_rates_them(runs: list[PreparedRun]) -> None:
    sensor = 'accelerometer'
    noise = fit_noise(runs, sensor)
    reached = reached_without_effect(runs, {sensor: noise}, {sensor: LINE}, EFFECTS, 1, seed=4)
    rng = np.random.default_rng([4, 0])
    drawn = [draw_noise(noise, run.slot, run.period, rng) for run in runs]
    source = ColumnSource(runs)
    steady = CandidateDesign(source, sensor, noise, LINE, drawn)
    slow = CandidateDesign(source, sensor, fit_noise_to_values(runs, drawn), LINE, drawn)
    searched = {}
    drawn_lines = {name for name, effect in EFFECTS.items() if effect().line_frequency is not None}
    for design, time_only in ((steady, False), (slow, True)):
        offered = {
            n: e for n, e in EFFECTS.items() if e.time_only == time_only and n not in drawn_lines
        }
        for scored in Search(design, families(design, offered)).ranking([]):
            searched[scored.name] = scored.evidence
    assert {'thermal_lag', 'thermal_hysteresis', 'fixture_tilt', 'bias_step'} <= set(searched)
    for name, evidence in searched.items():
        assert reached[name][0] == pytest.approx(evidence, abs=1e-3), name


def test_thresholds_never_fall_below_the_effects_own(runs: list[PreparedRun]) -> None:
    catalogue = {name: EFFECTS[name] for name in ('thermal_lag', 'bias_drift', 'bias_step')}
    found = calibrated_thresholds(runs[:1], {'gyroscope': LINE, **_all_lines()}, catalogue, 8)
    assert set(found) == set(catalogue)
    for name, effect in catalogue.items():
        assert threshold_of(effect, found) == found[name] >= effect.least_evidence
        assert threshold_of(effect) == effect.least_evidence


def test_noise_slower_than_the_fit_believes_raises_thresholds(runs: list[PreparedRun]) -> None:
    white = NoiseModel(np.full(3, 1e-3), np.array([3e4]), np.zeros((1, 3)))
    lines = {'accelerometer': LINE}
    catalogue = {'bias_drift': EFFECTS['bias_drift']}
    quiet = reached_without_effect(runs, {'accelerometer': white}, lines, catalogue, 20)
    walking = NoiseModel(np.full(3, 1e-3), np.array([3e6]), np.full((1, 3), 1e-1))
    loud = reached_without_effect(runs, {'accelerometer': walking}, lines, catalogue, 20)
    assert np.median(loud['bias_drift']) > np.median(quiet['bias_drift'])


def test_the_tail_is_extrapolated_where_draws_are_few() -> None:
    rng = np.random.default_rng(0)
    exact = -np.log(0.005)
    found = [tail_quantile(rng.exponential(1.0, 200), 0.995) for _ in range(40)]
    assert np.mean(found) == pytest.approx(exact, rel=0.12)


def _all_lines() -> dict[str, tuple]:
    return dict.fromkeys(('accelerometer', 'gyroscope', 'magnetometer'), LINE)
