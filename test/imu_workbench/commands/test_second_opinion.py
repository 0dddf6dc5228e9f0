# SPDX-License-Identifier: Apache-2.0
"""The verb `second-opinion` on logs an autopilot would have kept."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from imu_workbench.__main__ import main

from imu_recording import ImuRecording, read_bag, write_bag


@pytest.fixture(scope='module')
def board(bags: Path) -> ImuRecording:
    """Ten hours, one sample in four."""
    return read_bag(bags / 'dut1_z').rows(slice(None, None, 4))


@pytest.mark.long
def test_logs_are_judged_by_their_own_autopilot(
    writers: ModuleType, board: ImuRecording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ulog, dataflash = tmp_path / 'flight.ulg', tmp_path / 'flight.bin'
    ulog.write_bytes(writers.ulog_bytes([board]))
    dataflash.write_bytes(writers.dataflash_bytes([board]))
    told, picture = tmp_path / 's.json', tmp_path / 'o.png'
    command = ['second-opinion', str(ulog), str(dataflash)]
    assert main([*command, '--json', str(told), '--plot', str(picture)]) == 0
    assert picture.read_bytes().startswith(b'\x89PNG')
    imus = json.loads(told.read_text())['imus']
    assert [imu['autopilot'] for imu in imus] == ['px4', 'ardupilot']
    for imu in imus:
        assert imu['lag_or_curve'] == 'told apart'
        assert len(imu['verdict']) == 3
        assert set(imu['sensors']) == {'accelerometer', 'gyroscope'}
    assert "PX4's curves between" in capsys.readouterr().out
    assert main([*command, '--plot', str(picture)]) == 2  # the picture exists


def test_what_is_no_log_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / 'board.csv'
    table.write_text('t,x\n0,1\n')
    assert main(['second-opinion', str(table)]) == 2
    assert '`import` it' in capsys.readouterr().err
    assert main(['second-opinion', str(tmp_path / 'missing.ulg')]) == 2


def test_a_bag_is_judged_device_by_device_and_a_sensor_that_is_dead_is_named(
    board: ImuRecording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dead = board.angular_velocity.copy()
    dead[:, 1] = 0.0
    one = replace(board, namespace='/dut1')
    other = replace(board, device='dut2', namespace='/dut2', angular_velocity=dead)
    write_bag([one, other], tmp_path / 'pair')
    told = tmp_path / 's.json'
    storage = next((tmp_path / 'pair').glob('*.mcap'))
    assert main(['second-opinion', str(storage), '--json', str(told)]) == 0
    first, second = json.loads(told.read_text())['imus']
    assert [imu['imu'].split()[-1] for imu in (first, second)] == ['/dut1', '/dut2']
    assert first['notes'] == []
    assert set(second['sensors']) == {'accelerometer'}
    assert second['notes'] == ['gyroscope left out: axis y of run log never changes']
    assert second['notes'][0] in capsys.readouterr().out


@pytest.mark.long
def test_logs_of_one_board_are_judged_by_one_another(
    writers: ModuleType, board: ImuRecording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    half = len(board) // 2
    turned = replace(board, angular_velocity=-board.angular_velocity)
    paths = [tmp_path / f'{name}.ulg' for name in ('monday', 'friday', 'turned')]
    for path, part in zip(
        paths, (board.rows(slice(half)), board.rows(slice(half, None)), turned), strict=True
    ):
        path.write_bytes(writers.ulog_bytes([part]))
    told = tmp_path / 's.json'
    names = [str(path) for path in paths]
    assert main(['second-opinion', *names[:2], '--json', str(told)]) == 0
    (row,) = json.loads(told.read_text())['other_logs']
    assert row['logs'] == [f'{name} imu0' for name in names[:2]]
    for part in row['sensors'].values():
        assert part['pairs'] == 2
        assert np.linalg.norm(part['left_rms']) < 0.5 * np.linalg.norm(part['raw_rms'])
    assert 'the curve of one log leaves on the others' in capsys.readouterr().out
    # What is right of one board is wrong of one whose gyroscope drifts the other way.
    assert main(['second-opinion', names[0], names[2], '--json', str(told)]) == 0
    (row,) = json.loads(told.read_text())['other_logs']
    assert 'they make the gyroscope worse' in row['verdict']
