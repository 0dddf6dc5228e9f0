# SPDX-License-Identifier: Apache-2.0
"""A bag whose gyroscope lags, a line fitted to it, and what a verb answers."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
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
