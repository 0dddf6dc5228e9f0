# SPDX-License-Identifier: Apache-2.0
"""Bags with known errors, models fitted to them, and what a verb answers."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imu_recording.bags.messages import BagMessage, bag_topics, read_messages, write_messages
from imu_workbench.__main__ import main

from imu_recording import write_bag

from .asking import Answer


@pytest.fixture(scope='session')
def bag(run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One run whose gyroscope lags behind the thermometer by 100 s."""
    recording = run(cycles=4)
    lagged = np.empty_like(recording.temperature)
    level = lagged[0] = recording.temperature[0]
    for i, value in enumerate(recording.temperature.tolist()):
        level += (value - level) / 100.0
        lagged[i] = level
    error = np.outer(lagged - recording.temperature, [3e-4, -2e-4, 1e-4])
    path = tmp_path_factory.mktemp('lag') / 'z'
    write_bag(replace(recording, angular_velocity=recording.angular_velocity + error), path)
    return path


@pytest.fixture(scope='session')
def model(bag: Path) -> Path:
    target = bag.parent / 'line.yaml'
    assert main(['fit', str(bag), '-o', str(target)]) == 0
    return target


@pytest.fixture
def answer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Answer:
    def ask(*arguments: object) -> tuple[int, dict[str, Any], str]:
        target = tmp_path / 'answer.json'
        target.unlink(missing_ok=True)
        code = main([*map(str, arguments), '--json', str(target)])
        shown = capsys.readouterr()
        content = json.loads(target.read_text()) if target.exists() else {}
        return code, content, shown.err if code == 2 else shown.out

    return ask


@pytest.fixture(scope='session')
def device_bags(run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bags of two devices, one with both in namespaces."""
    path = tmp_path_factory.mktemp('bags')
    for device in ('dut1', 'dut2'):
        write_bag(run(device, 'z', cycles=3), path / device)
    both = [replace(run(d, cycles=3), namespace=f'/{d}') for d in ('dut1', 'dut2')]
    write_bag(both, path / 'both')
    return path


@pytest.fixture(scope='session')
def dut1_model(device_bags: Path) -> Path:
    target = device_bags / 'dut1.yaml'
    assert main(['fit', str(device_bags / 'dut1'), '-o', str(target)]) == 0
    return target


@pytest.fixture
def robot(device_bags: Path, tmp_path: Path) -> tuple[Path, Path]:
    """A bag under a robot's own names, with a topic nobody here reads, and the file of names."""
    names = {
        'imu/data_raw': '/camera/imu',
        'imu/mag': '/compass',
        'imu/temperature': '/camera/temperature',
    }
    types = {t: kind for t, kind in bag_topics(device_bags / 'dut1').items() if t[1:] in names}
    messages = read_messages(device_bags / 'dut1', list(types))
    text = b'\x00\x01\x00\x00\x03\x00\x00\x00hi\x00'
    renamed = [replace(m, topic=names[m.topic[1:]]) for m in messages]
    kinds = {names[t[1:]]: kind for t, kind in types.items()}
    write_messages(
        [BagMessage(messages[0].received, '/chatter', text), *renamed],
        {**kinds, '/chatter': 'std_msgs/msg/String'},
        tmp_path / 'robot',
    )
    rules = tmp_path / 'robot.yaml'
    rules.write_text(''.join(f'{name}: {other}\n' for name, other in names.items()))
    return tmp_path / 'robot', rules
