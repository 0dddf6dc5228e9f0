# SPDX-License-Identifier: Apache-2.0
"""next-experiment: the profile runs in the chamber and tells the rivals apart, or says why not."""

from pathlib import Path

import numpy as np
import pytest
from chamber_profile.profile.file import load_profile
from imu_workbench.commands.next_experiment import assumed_sizes
from thermal_comp.effects import EFFECTS
from thermal_comp.model.values import SensorModel, ThermalModel

from .asking import Answer, refuses


@pytest.mark.long
def test_the_next_experiment_runs_in_the_chamber(
    model: Path, tmp_path: Path, answer: Answer
) -> None:
    target = tmp_path / 'next.yaml'
    code, content, _ = answer(
        'next-experiment',
        'thermal_lag',
        'temperature_rate',
        '--model',
        model,
        '--range',
        '0',
        '45',
        '--max-rate',
        '1.5',
        '--hours',
        '10',
        '-o',
        target,
    )
    assert code == 0
    assert content['evidence_after'] >= content['evidence_before'] > 0.0
    assert content['separable'] is (content['evidence_after'] >= 20.0)
    assert content['separable'] or content['actions']
    profile = load_profile(target)
    assert profile.name == 'thermal_lag_or_temperature_rate'
    code, planned, text = answer('plan', target)
    assert code == 0
    assert 'no violation of the limits' in text
    assert content['repeats'] >= 3
    assert content['hours'] <= 10.0
    assert planned


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (('thermal_lag', 'magic'), "'magic' is not known"),
        (('thermal_lag', 'thermal_lag'), 'the same effect'),
        (('thermal_lag', 'temperature_rate', '--hours', '1'), 'too short'),
        (('thermal_lag', 'temperature_rate', '--hours', '-1'), 'more than 0'),
        (('thermal_lag', 'temperature_rate', '--max-rate', '0'), 'more than 0'),
        (('thermal_lag', 'temperature_rate', '--range', '30', '50'), 'LOW < 20'),
        (('g_sensitivity_temperature', 'heater_hard_iron'), 'no common sensor'),
    ],
)
def test_experiments_that_cannot_be_are_refused(
    model: Path, tmp_path: Path, answer: Answer, arguments: tuple[str, ...], reason: str
) -> None:
    target = tmp_path / 'next.yaml'
    line = refuses(answer, 'next-experiment', *arguments, '--model', model, '-o', target)
    assert reason in line
    assert not target.exists()


def test_the_size_a_plan_assumes_is_the_models_own_where_it_has_one() -> None:
    lag = SensorModel((EFFECTS['thermal_lag'](),), (np.zeros((1, 3)),), np.zeros((3, 3)))
    model = ThermalModel('dut1', {'gyroscope': lag})
    own, usual = assumed_sizes(['thermal_lag', 'bias_step'], model, 'gyroscope')
    assert own == 'thermal_lag: as the model has it'
    assert usual.startswith('bias_step: M = 1')
