# SPDX-License-Identifier: Apache-2.0
"""Campaigns with a hidden effect: made, revealed, and a diagnosis scored against the truth."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imu_driver.simulation.hidden import UNLOGGED
from imu_recording.recording import SENSOR_FIELDS
from imu_workbench.__main__ import main
from imu_workbench.simulate.campaign import Logging
from imu_workbench.simulate.hidden_effect import (
    Campaign,
    HiddenEffect,
    find_truth,
    hidden_campaign,
    score_diagnosis,
)

from imu_recording import read_bag

SHORT = 'short_20min'
MEANS = Logging(0.2, mean=True, chamber_period=5.0)


def campaign(name: str, size: float = 3.0, sensor: str | None = None) -> Campaign:
    return hidden_campaign(SHORT, 'dut2', MEANS, HiddenEffect(name, size, sensor), seed=2)


@pytest.fixture(scope='module')
def plain() -> Campaign:
    return campaign('nothing')


def test_nothing_hidden_is_the_campaign_itself(plain: Campaign) -> None:
    assert plain.truth.kind == 'nothing'
    assert [run.up_axis for run in plain.recordings] == ['+x', '+y', '+z']


@pytest.mark.parametrize('sensor', SENSOR_FIELDS)
def test_an_effect_changes_its_sensor_and_no_other(plain: Campaign, sensor: str) -> None:
    found = campaign('thermal_lag', sensor=sensor)
    assert (found.truth.name, found.truth.sensor) == ('thermal_lag', sensor)
    for run, other in zip(found.recordings, plain.recordings, strict=True):
        for part, name in SENSOR_FIELDS.items():
            same = np.array_equal(getattr(run, name), getattr(other, name))
            assert same == (part != sensor)


@pytest.mark.parametrize('name', UNLOGGED)
def test_an_unlogged_cause_leaves_no_track(name: str) -> None:
    found = campaign(name)
    assert (found.truth.name, found.truth.kind) == (None, 'unlogged')
    assert 'chamber' in found.truth.depends_on
    for run in found.recordings:
        assert getattr(run, name.removeprefix('unlogged_')) is None


def test_a_drifting_clock_stretches_the_stamps_with_temperature() -> None:
    found = campaign('clock_temperature')
    slope = found.truth.parameters['relative_rate_per_kelvin']
    assert abs(slope) == pytest.approx(60e-6)
    run = found.recordings[0]
    pace = 5.0 / (np.diff(run.stamp) * 1e-9) - 1.0
    fitted = np.polyfit(run.temperature[1:], pace, 1)[0]
    assert fitted == pytest.approx(slope, rel=0.02)


def test_faults_do_what_their_names_say(plain: Campaign) -> None:
    stuck = campaign('stuck_value', sensor='gyroscope').recordings[0].angular_velocity
    assert np.sum(np.all(np.diff(stuck, axis=0) == 0.0, axis=1)) > 30
    spiky = campaign('spikes', sensor='gyroscope').recordings[0].angular_velocity
    clean = plain.recordings[0].angular_velocity
    assert np.sum(np.any(spiky != clean, axis=1)) == 40
    odd = campaign('unit_mismatch', sensor='magnetometer').recordings
    ratio = [np.median(np.abs(run.magnetic_field)) for run in odd]
    assert max(ratio) / min(ratio) > 1e5
    full = campaign('saturation', sensor='magnetometer').recordings[0].magnetic_field
    assert np.max(np.mean(full == full.max(axis=0), axis=0)) > 0.05
    first = campaign('startup_transient').recordings[0].linear_acceleration
    whole = plain.recordings[0].linear_acceleration
    np.testing.assert_allclose(first[0] / whole[0], 0.543, rtol=1e-3)


def test_what_needs_cycles_says_so() -> None:
    with pytest.raises(ValueError, match='at least two cycles'):
        campaign('orientation_flip')


def test_simulate_hides_and_keeps_the_truth_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / 'secret'
    command = [
        'simulate',
        SHORT,
        '--device',
        'dut3',
        '--hide',
        'temperature_rate',
        '--magnitude',
        '4',
        '--sensor',
        'gyroscope',
        '--rate',
        '0.2',
        '--seed',
        '5',
        '-o',
        str(folder),
    ]
    assert main(command) == 0
    assert 'temperature_rate' not in capsys.readouterr().out
    truth, found = find_truth(folder)
    assert (truth['name'], truth['sensor'], truth['magnitude']) == (
        'temperature_rate',
        'gyroscope',
        4.0,
    )
    assert [path.name for path in found] == ['x', 'y', 'z']
    assert read_bag(found[2]).up_axis == '+z'
    assert main(command) == 2  # a second one in the same folder
    assert 'holds a hidden effect already' in capsys.readouterr().err


@pytest.mark.parametrize('axis', ['x', '-x'])
def test_simulate_makes_one_bag_of_one_orientation(tmp_path: Path, axis: str) -> None:
    answer = tmp_path / 'answer.json'
    assert (
        main(
            [
                'simulate',
                SHORT,
                '--orientation',
                axis,
                '--rate',
                '0.5',
                '--seed',
                '3',
                '-o',
                str(tmp_path / 'bag'),
                '--json',
                str(answer),
            ]
        )
        == 0
    )
    recording = read_bag(tmp_path / 'bag')
    assert recording.up_axis == f'{"" if axis[0] == "-" else "+"}{axis}'
    content = json.loads(answer.read_text())
    assert content['bags'][0]['samples'] == len(recording)


@pytest.mark.parametrize(
    ('more', 'said'),
    [
        (['--rate', '0'], '--rate 0'),
        (['--sensor', 'gyroscope'], 'needs --hide'),
        (['--hide', 'thermal_lag', '--orientation', 'x'], 'all three orientations'),
        (['--hide', 'thermal_lag', '--magnitude', '-1'], '--magnitude'),
        (['--hide', 'thermal_lag', '--rate', '50'], 'at most 10 Hz'),
        (['--hide', 'turn_on_bias'], 'at least two cycles'),
        (['--hide', 'tea'], "cannot hide 'tea'"),
    ],
)
def test_mistakes_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], said: str
) -> None:
    assert main(['simulate', SHORT, '-o', str(tmp_path / 'bag'), *more]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / 'bag').exists()


def test_the_bundled_truth_is_found(bags: Path) -> None:
    truth, found = find_truth(bags)
    assert all(path.is_dir() for path in found)
    assert truth['kind'] == 'effect'


def finding(**values: Any) -> dict[str, Any]:
    return {'kind': 'effect', 'ambiguous_with': [], 'depends_on': None, **values}


LAG = {'kind': 'effect', 'name': 'thermal_lag', 'sensor': 'gyroscope', 'depends_on': []}


@pytest.mark.parametrize(
    ('truth', 'findings', 'outcome', 'right'),
    [
        (LAG, [finding(name='thermal_lag', sensor='gyroscope')], 'named', True),
        (LAG, [finding(name='thermal_lag', sensor='magnetometer')], 'named', False),
        (
            LAG,
            [finding(name='temperature_rate', sensor='gyroscope', ambiguous_with=['thermal_lag'])],
            'in_set',
            True,
        ),
        (LAG, [finding(name='temperature_rate', sensor='gyroscope')], 'wrong', False),
        (LAG, [finding(kind='unexplained', name=None, sensor='gyroscope')], 'wrong', False),
        (LAG, [finding(kind='noise', name=None, sensor='gyroscope')], 'missed', False),
        (LAG, [], 'missed', False),
        ({'kind': 'nothing', 'name': None, 'sensor': None}, [], 'named', True),
        (
            {'kind': 'nothing', 'name': None, 'sensor': None},
            [finding(kind='noise', name=None, sensor='all')],
            'named',
            True,
        ),
        (
            {'kind': 'nothing', 'name': None, 'sensor': None},
            [finding(name='icing', sensor='gyroscope')],
            'wrong',
            True,
        ),
        (
            {
                'kind': 'unexplained',
                'name': None,
                'sensor': 'gyroscope',
                'depends_on': ['temperature', 'time'],
            },
            [finding(kind='unexplained', name=None, sensor='gyroscope', depends_on='time')],
            'named',
            True,
        ),
        (
            {
                'kind': 'unlogged',
                'name': None,
                'sensor': 'magnetometer',
                'depends_on': ['heater', 'chamber'],
            },
            [finding(kind='unlogged', name=None, sensor='magnetometer', depends_on='chamber')],
            'named',
            True,
        ),
        (
            {
                'kind': 'unlogged',
                'name': None,
                'sensor': 'magnetometer',
                'depends_on': ['heater', 'chamber'],
            },
            [finding(name='thermal_gradient', sensor='magnetometer')],
            'wrong',
            False,
        ),
        (
            {'kind': 'data_quality', 'name': 'spikes', 'sensor': 'gyroscope'},
            [finding(kind='data_quality', name='spikes', sensor='gyroscope')],
            'named',
            True,
        ),
    ],
)
def test_a_diagnosis_is_judged_by_the_truth(
    truth: dict[str, Any], findings: list[dict[str, Any]], outcome: str, right: bool
) -> None:
    score = score_diagnosis(truth, {'findings': findings})
    assert score.outcome == outcome
    assert score.right == (right and outcome != 'wrong')


def test_reveal_diagnoses_first_and_then_opens_the_truth(
    bags: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['reveal', str(bags), '--json', str(tmp_path / 'answer.json')]) == 0
    content = json.loads((tmp_path / 'answer.json').read_text())
    assert content['right']
    assert content['outcome'] == 'named'
    assert content['truth']['name'] in capsys.readouterr().out
    assert main(['reveal', str(tmp_path)]) == 2
    assert 'no truth here' in capsys.readouterr().err
