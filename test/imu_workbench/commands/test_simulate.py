# SPDX-License-Identifier: Apache-2.0
"""simulate: bags of one orientation or three, a secret kept apart, one line for every mistake."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from imu_workbench.__main__ import main
from imu_workbench.simulate.hidden_effect import find_truth

from imu_recording import read_bag

SHORT = 'short_20min'


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
        (['--hide', 'icing,warm_up', '--magnitude', '1,2,3'], 'has 3 values for 2 effects'),
        (['--hide', 'icing,warm_up', '--magnitude', '1,big'], '--magnitude big'),
        (['--hide', 'icing,tea'], "cannot hide 'tea'"),
        (['--hide', 'icing', '--sensor', 'barometer'], '--sensor barometer'),
        (['--aged', '--orientation', 'x'], '--aged makes all three orientations'),
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


def test_a_fleet_needs_sensible_numbers(tmp_path: Path) -> None:
    verb = ['simulate', 'short_20min', '-o', str(tmp_path / 'f')]
    assert main([*verb, '--lots', '2']) == 2
    assert main([*verb, '--fleet', '0']) == 2
    assert main([*verb, '--fleet', '30', '--lots', '27']) == 2
    assert main([*verb, '--fleet', '2', '--hide', 'icing']) == 2
    assert not (tmp_path / 'f').exists()
