# SPDX-License-Identifier: Apache-2.0
"""An interrupt ends a node between two callbacks, never inside one."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import os, signal, sys
from imu_recording.lifecycle_node import ConfiguredNode
from imu_recording.run_node import run_node

class Interrupted(ConfiguredNode):
    event_driven = {event_driven}

    def __init__(self):
        super().__init__('interrupted')
        self.create_timer(0.01, self.work)

    def setup(self, config):
        if {refuse}:
            raise ValueError('no such board')

    def work(self):
        os.kill(os.getpid(), signal.{number})
        self.publish_diagnostics()
        print('finished')

    def deactivated(self):
        os.kill(os.getpid(), signal.SIGINT)
        self.publish_diagnostics()
        print('released', flush=True)

sys.exit(run_node(Interrupted))
"""


def run(folder: Path, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-c', SCRIPT.format(**options)],
        env={**os.environ, 'ROS_LOG_DIR': str(folder)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.parametrize('event_driven', [False, True])
@pytest.mark.parametrize('number', ['SIGINT', 'SIGTERM'])
def test_a_callback_ends_before_the_node_does(
    tmp_path: Path, number: str, *, event_driven: bool
) -> None:
    done = run(tmp_path, number=number, event_driven=event_driven, refuse=False)
    assert (done.returncode, done.stderr) == (0, '')
    assert done.stdout.splitlines()[0] == 'finished'
    assert done.stdout.splitlines()[-1] == 'released'


def test_a_refused_configuration_ends_with_code_2(tmp_path: Path) -> None:
    done = run(tmp_path, number='SIGINT', event_driven=False, refuse=True)
    assert done.returncode == 2
    assert 'no such board' in done.stdout + done.stderr
