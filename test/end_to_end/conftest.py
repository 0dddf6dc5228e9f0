# SPDX-License-Identifier: Apache-2.0
"""Real processes for the end-to-end tests: start, listen, stop with Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]


class Processes:
    """Real executables in one ROS domain."""

    def __init__(self, folder: Path, domain: int) -> None:
        self.environment = {
            **os.environ, 'ROS_DOMAIN_ID': str(domain), 'ROS_LOG_DIR': str(folder),
        }  # fmt: skip
        self.folder = folder
        self.running: list[tuple[str, subprocess.Popen[str], Path]] = []

    def start(self, package: str, executable: str, *arguments: str) -> subprocess.Popen[str]:
        """Start one executable as `ros2 run` would; its output goes to a file."""
        path = ROOT / 'install' / package / 'lib' / package / executable
        log = self.folder / f'{len(self.running)}_{executable}.txt'
        with log.open('w') as output:
            process = subprocess.Popen(
                [str(path), *arguments],
                env=self.environment,
                stdout=output,
                stderr=subprocess.STDOUT,
                text=True,
            )
        self.running.append((executable, process, log))
        return process

    def listen(self, count: int, seconds: float, *topics: str) -> dict[str, Any]:
        """Return what a subscriber that knows nothing of this project received."""
        script = Path(__file__).with_name('foreign_subscriber.py')
        done = subprocess.run(
            [sys.executable, str(script), str(count), str(seconds), *topics],
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=seconds + 30,
            check=False,
        )
        assert done.stdout, done.stderr
        result: dict[str, Any] = json.loads(done.stdout)
        assert done.returncode == 0, (result['received'], self.logs())
        return result

    def interrupt(self, signals: int = 1) -> None:
        """Send Ctrl-C (as often as given) to all and demand clean exits."""
        for _ in range(signals):
            for _, process, _ in self.running:
                process.send_signal(signal.SIGINT)
        for name, process, log in self.running:
            try:
                code = process.wait(timeout=60)
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGABRT)  # it says where its threads stand
                code = process.wait()
            assert code == 0, (name, log.read_text())
            assert 'Traceback' not in log.read_text(), (name, log.read_text())
        self.running.clear()

    def logs(self) -> str:
        """What the processes printed so far."""
        return '\n'.join(f'--- {name}\n{log.read_text()}' for name, _, log in self.running)

    def kill(self) -> None:
        """Leave nothing behind."""
        for _, process, _ in self.running:
            process.kill()
            process.wait()


@pytest.fixture
def processes(tmp_path: Path, ros_domains: Iterator[int]) -> Iterator[Processes]:
    """Start real executables; whatever still runs at the end is killed."""
    group = Processes(tmp_path, next(ros_domains))
    yield group
    group.kill()


@pytest.fixture(scope='session')
def dut1_model(tmp_path_factory: pytest.TempPathFactory, bags: Path) -> Path:
    """File of the paper's linear model, fitted on the three bags of dut1."""
    from thermal_comp.effects import EFFECTS
    from thermal_comp.fitting.fit import fit
    from thermal_comp.model.file import save_model

    from imu_recording import read_bag

    recordings = [read_bag(bags / f'dut1_{axis}') for axis in 'xyz']
    path = tmp_path_factory.mktemp('model') / 'dut1.yaml'
    save_model(fit((EFFECTS['bias_temperature'](),), recordings), path)
    return path
