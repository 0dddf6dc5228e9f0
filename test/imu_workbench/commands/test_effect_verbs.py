# SPDX-License-Identifier: Apache-2.0
"""The verbs about effects, through the front end: answers, files, one line for every mistake."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chamber_profile.profile.file import load_profile
from imu_workbench.commands.auto import defect_lines
from imu_workbench.commands.next_experiment import assumed_sizes
from thermal_comp.data.quality import check_quality
from thermal_comp.diagnosis.explanations import FINDINGS
from thermal_comp.effects import EFFECTS
from thermal_comp.model.file import load_model
from thermal_comp.model.values import SensorModel, ThermalModel

from imu_recording import read_bag

from .asking import OWN, Answer, refuses


def test_auto_adds_until_nothing_is_missing(bag: Path, tmp_path: Path, answer: Answer) -> None:
    target = tmp_path / 'auto.yaml'
    code, content, _ = answer('auto', bag, '-o', target)
    assert code == 0
    assert content['steps']
    first = content['steps'][0]
    assert set(first) >= {'added', 'error_before', 'error_after', 'noise_floor'}
    assert first['error_after'] < first['error_before']
    named = {first['added'], *first['ambiguous_with']}
    assert named & {'thermal_lag', 'thermal_lag_two_stage'}
    assert content['verdict'] in ('complete', 'ambiguous')
    held = {effect.name for effect in load_model(target).sensors['gyroscope'].effects}
    assert first['added'] in held


def test_auto_says_what_it_left_out_and_why(bag: Path) -> None:
    recording = read_bag(bag)
    in_g = replace(recording, linear_acceleration=recording.linear_acceleration / 9.80665)
    first, *why = defect_lines(check_quality([in_g])[1])
    assert first.endswith('left out of what follows: unit_mismatch (accelerometer)')
    assert why[0].endswith('as if in g')
    assert not defect_lines(check_quality([recording])[1])


def test_mistakes_of_add_and_auto_are_one_line(
    bag: Path, model: Path, tmp_path: Path, answer: Answer
) -> None:
    out = tmp_path / 'm.yaml'
    line = refuses(answer, 'add', 'magic', bag, '-o', out)
    assert "'magic' is not known; known: bias_temperature" in line
    line = refuses(answer, 'add', 'supply_sensitivity', bag, '-o', out)
    assert 'supply_voltage, which was not logged' in line
    line = refuses(answer, 'add', 'heater_hard_iron', bag, '--sensor', 'gyroscope', '-o', out)
    assert 'heater' in line
    line = refuses(answer, 'auto', bag, '--model', tmp_path / 'none.yaml', '-o', out)
    assert 'none.yaml' in line
    assert 'no such file' in refuses(answer, 'auto', tmp_path / 'nothing', '-o', out)
    assert not out.exists()


def test_an_effect_of_ones_own_is_checked_explained_and_added(
    bag: Path, tmp_path: Path, answer: Answer
) -> None:
    file = tmp_path / 'rhythm.py'
    file.write_text(OWN)
    code, content, text = answer('check-effect', file)
    assert (code, content) == (0, {'effects': {'daily_rhythm': []}, 'ok': True})
    assert 'keeps the contract' in text
    _, content, text = answer('explain', 'daily_rhythm', '--effects', file)
    assert 'a · sin(2πt/P)' in text
    assert content['parameters']['period']['bounds'] == [600.0, 9000.0]
    grown = tmp_path / 'grown.yaml'
    code, _, _ = answer('add', 'daily_rhythm', bag, '--effects', file, '-o', grown)
    assert code == 0
    assert "'daily_rhythm' is not in the catalogue" in refuses(
        answer, 'compare', bag, '--model', grown
    )


@pytest.mark.parametrize('name', sorted(EFFECTS))
def test_every_effect_is_explained_with_all_it_has(name: str, answer: Answer) -> None:
    code, content, text = answer('explain', name)
    assert code == 0
    effect = EFFECTS[name]
    for part in (effect.equation, effect.separation, effect.typical_size, effect.reference):
        assert part
        assert part.split()[0] in text
    for parameter in effect().shape_parameters:
        assert parameter in text
        low, high = content['parameters'][parameter]['bounds']
        assert low < high
    for channel in effect.channels:
        assert channel in text


@pytest.mark.parametrize('name', sorted(FINDINGS))
def test_every_finding_without_columns_is_explained_too(name: str, answer: Answer) -> None:
    code, content, text = answer('explain', name)
    assert code == 0
    assert content['kind'] in {'effect', 'noise', 'data_quality'}
    assert name not in EFFECTS
    for part in (content['seen'], content['separation'], content['remedy']):
        assert part in text


def test_the_catalogue_goes_to_a_file(tmp_path: Path, answer: Answer) -> None:
    target = tmp_path / 'physics.md'
    code, content, _ = answer('explain', '--all', '-o', target)
    assert code == 0
    assert set(content) == set(EFFECTS)
    written = target.read_text()
    assert all(name in written for name in EFFECTS)
    assert "'magic' is no effect, finding or word" in refuses(answer, 'explain', 'magic')


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
