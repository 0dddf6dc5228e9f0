# SPDX-License-Identifier: Apache-2.0
"""The verb `export`: files, refusals, what it says."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest
from imu_workbench.__main__ import main

FIRMWARE = Path(__file__).parents[3] / 'firmware'


@pytest.fixture(scope='module')
def model(bags: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp('model') / 'dut1.yaml'
    assert main(['fit', str(bags / 'dut1_z'), '-o', str(target)]) == 0
    return target


@pytest.mark.long
def test_c99_holds_against_its_own_vectors(model: Path, bags: Path, tmp_path: Path) -> None:
    target, told = tmp_path / 'thermal', tmp_path / 'told.json'
    command = ['export', str(model), str(bags / 'hidden_effect_x'), '--to', 'c99']
    assert main([*command, '-o', str(target), '--json', str(told)]) == 2  # another device
    command[2] = str(bags / 'dut1_x')
    assert main([*command, '-o', str(target), '--json', str(told)]) == 0
    content = json.loads(told.read_text())
    assert content['vectors'] > 20_000
    assert sorted(path.name for path in target.iterdir()) == sorted(content['files'])
    for tool in ('cc', 'make'):
        assert shutil.which(tool), f'no {tool}: apt install build-essential'
    check = ['make', '-C', FIRMWARE, 'test', f'THERMAL={target}', f'BUILD={tmp_path}/build']
    done = subprocess.run(check, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert 'single precision, state' in done.stdout


def test_nothing_is_replaced_without_force(model: Path, tmp_path: Path, capsys) -> None:
    command = ['export', str(model), '--to', 'c99', '-o', str(tmp_path)]
    mine = tmp_path / 'imu_thermal.c'
    mine.write_text('mine')
    assert main(command) == 2
    assert 'imu_thermal.c exists already' in capsys.readouterr().err
    assert mine.read_text() == 'mine'
    assert main([*command, '--force']) == 0
    assert 'imu_thermal_update' in mine.read_text()


def test_parameters_say_what_is_lost(model: Path, bags: Path, tmp_path: Path, capsys) -> None:
    told, target = tmp_path / 'told.json', tmp_path / 'board.params'
    command = ['export', str(model), '--to', 'px4', '-o', str(target), '--json', str(told)]
    assert main([*command, '--accel-id', '2424842']) == 0
    said = capsys.readouterr().out
    assert 'gyroscope: the cubic keeps 100 %' in said
    assert 'magnetometer: not exported' in said
    assert 'not in the file: TC_G0_ID (--gyro-id)' in said
    assert '\tTC_A0_ID\t2424842\t6\n' in target.read_text()
    assert main(command) == 2
    assert 'exists already' in capsys.readouterr().err
    command[1:2] = [str(model), str(bags / 'dut1_z')]
    assert main([*command, '--force', '--instance', '1']) == 0
    assert 'held out in the recordings (x y z): cubic' in capsys.readouterr().out
    row = json.loads(told.read_text())['sensors']['gyroscope']
    assert row['held_out_cubic'] == pytest.approx(row['held_out_model'], rel=0.1)
    assert 'TC_G1_X3_2' in target.read_text()


def test_ardupilot_and_kalibr(model: Path, tmp_path: Path) -> None:
    for form, line in (
        ('ardupilot', 'INS_TCAL1_ENABLE 1'),
        ('kalibr', 'update_rate: 200  # [Hz]'),
    ):
        target = tmp_path / form
        command = ['export', str(model), '--to', form, '-o', str(target), '--rate', '200']
        assert main(command) == 0
        assert line in target.read_text().splitlines()
    assert main([*command, '--force', '--rate', '0']) == 2
