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


def test_c99_holds_against_its_own_vectors(model: Path, bags: Path, tmp_path: Path) -> None:
    target, told = tmp_path / 'thermal', tmp_path / 'told.json'
    command = ['export', str(model), str(bags / 'hidden_effect_x'), '--to', 'c99']
    assert main([*command, '-o', str(target), '--json', str(told)]) == 2  # another device
    command[2] = str(bags / 'dut1_x')
    assert main([*command, '-o', str(target), '--json', str(told)]) == 0
    content = json.loads(told.read_text())
    assert content['vectors'] > 20_000
    assert sorted(path.name for path in target.iterdir()) == sorted(content['files'])
    if not (shutil.which('cc') and shutil.which('make')):
        pytest.skip('no C compiler here')
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
