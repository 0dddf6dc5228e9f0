# SPDX-License-Identifier: Apache-2.0
"""The verb `still` on logs that move."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from imu_workbench.__main__ import main

from imu_recording import ImuRecording, read_bag, write_bag

RATE = 25.0
SLOPE = 1e-3
"""Of every axis of the gyroscope [rad/s/K]."""


def flight(number: int, *, moves: bool = False) -> ImuRecording:
    """Return 3 min on the ground, warmer than the flight before, with 20 s of motion in them."""
    rng = np.random.default_rng(number)
    n = round(180 * RATE)
    time = np.arange(n) / RATE
    temperature = 10.0 + 5.0 * number + 4.0 * (1.0 - np.exp(-time / 100.0))
    rate = SLOPE * temperature[:, None] + 5e-4 * rng.standard_normal(3)
    force = np.tile([0.0, 0.0, -9.8], (n, 1)) + 0.01 * rng.standard_normal(3)
    moving = np.full(n, moves) | ((time > 100.0) & (time < 120.0))
    rate[moving] += 0.5 * np.sin(0.8 * time[moving])[:, None]
    return ImuRecording(
        stamp=np.round(time * 1e9).astype(np.int64),
        angular_velocity=rate + 1e-3 * rng.standard_normal((n, 3)),
        linear_acceleration=force + 0.01 * rng.standard_normal((n, 3)),
        magnetic_field=np.full((n, 3), np.nan),
        temperature=temperature,
        device='quad',
        run=f'f{number}',
    )


@pytest.fixture(scope='module')
def flights(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp('flights')
    for number in range(5):
        write_bag(flight(number), folder / f'f{number}')
    return [str(folder / f'f{number}') for number in range(5)]


@pytest.mark.long
def test_the_model_of_flights_is_one_that_apply_takes(
    flights: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, told, picture = tmp_path / 'm.yaml', tmp_path / 's.json', tmp_path / 'p.png'
    command = ['still', *flights, '-o', str(model)]
    assert main([*command, '--json', str(told), '--plot', str(picture)]) == 0
    said = capsys.readouterr().out
    assert 'gyroscope [°/s], change since' in said
    assert picture.read_bytes().startswith(b'\x89PNG')
    content = json.loads(told.read_text())
    assert [len(log['stretches']) for log in content['logs']] == [2] * 5
    part = content['curves']['sensors']['gyroscope']
    warmth = np.array(part['temperature']) - content['curves']['base_temperature']
    off = np.array(part['curve']) - SLOPE * warmth[:, None]
    assert (np.abs(off) <= 2.0 * np.array(part['band_95']) + 1e-12).all()
    assert np.abs(off).max() < 0.1 * SLOPE * np.ptp(warmth)
    compensated = tmp_path / 'compensated'
    assert main(['apply', flights[0], '--model', str(model), '-o', str(compensated)]) == 0
    before, after = read_bag(flights[0]), read_bag(compensated)
    rest = slice(0, round(100 * RATE))
    drift = [
        np.polyfit(before.temperature[rest], r.angular_velocity[rest], 1)[0]
        for r in (before, after)
    ]
    assert np.abs(drift[1]).max() < 0.1 * np.abs(drift[0]).max()
    assert main(command) == 2  # the model exists


def test_stretches_as_bags(flights: list[str], tmp_path: Path) -> None:
    assert main(['still', flights[0], '--bags', str(tmp_path / 'rests')]) == 0
    first, second = (read_bag(tmp_path / 'rests' / name) for name in ('f0_1', 'f0_2'))
    assert first.stamp[-1] < 100 * 10**9 < 120 * 10**9 < second.stamp[0]
    assert first.device == 'quad'


def test_logs_of_autopilots_are_read_as_they_are(
    writers: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, two = tmp_path / 'one.ulg', tmp_path / 'two.ulg'
    one.write_bytes(writers.ulog_bytes([flight(0)]))
    two.write_bytes(writers.ulog_bytes([flight(1), flight(2)]))
    assert main(['still', str(one)]) == 0
    assert main(['still', str(two)]) == 2
    assert 'several IMUs (0, 1): choose one with --imu' in capsys.readouterr().err
    assert main(['still', str(one), str(two), '--imu', '0', '-o', str(tmp_path / 'm.yaml')]) in {
        0,
        2,
    }
    assert main(['still', str(two), '--imu', '7']) == 2


def test_bad_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def refused(*arguments: str) -> str:
        assert main(['still', *arguments]) == 2
        return capsys.readouterr().err.splitlines()[-1]

    bag = tmp_path / 'moving'
    write_bag(flight(0, moves=True), bag)
    assert 'quietest seconds shake' in refused(str(bag))
    other = tmp_path / 'other'
    write_bag(replace(flight(1), device='another'), other)
    rest = tmp_path / 'rest'
    write_bag(flight(0), rest)
    model = str(tmp_path / 'm.yaml')
    assert 'several devices: another, quad' in refused(str(rest), str(other), '-o', model)
    assert main(['still', str(rest), str(other), '--device', 'quad', '-o', model]) == 0
    capsys.readouterr()
    assert '--least 0' in refused(str(rest), '--least', '0')
    assert '-o MODEL' in refused(str(rest), '--plot', str(tmp_path / 'p.png'))
    assert 'no such file' in refused(str(tmp_path / 'missing'))


@pytest.mark.parametrize('suffix', ['ulg', pytest.param('bin', marks=pytest.mark.long)])
def test_logs_with_gps_have_dates(
    suffix: str, writers: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write = writers.ulog_bytes if suffix == 'ulg' else writers.dataflash_bytes
    started = 1_767_225_600.0  # 2026-01-01
    paths = []
    for number in range(4):
        paths.append(tmp_path / f'f{number}.{suffix}')
        paths[-1].write_bytes(write([flight(number)], power_on=started + 5e6 * number))
    told, model = tmp_path / 's.json', tmp_path / 'm.yaml'
    command = ['still', *map(str, paths), '-o', str(model), '--json', str(told)]
    assert main(command) == 0
    content = json.loads(told.read_text())
    assert [log['started'][:10] for log in content['logs']] == [
        '2026-01-01', '2026-02-27', '2026-04-26', '2026-06-23',
    ]  # fmt: skip
    ages = [log['age_days'] for log in content['curves']['logs']]
    assert ages == pytest.approx([5e6 * (3 - k) / 86400.0 for k in range(4)], abs=0.01)
    said = capsys.readouterr().out
    assert '2026-06-23' in said
    assert 'ageing is not known' not in said
