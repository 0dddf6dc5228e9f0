# SPDX-License-Identifier: Apache-2.0
"""An interrupt ends a node between two callbacks, never inside one."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import os, signal, sys, time
from imu_recording.ros.lifecycle_node import ConfiguredNode
from imu_recording.ros.run_node import run_node

class Interrupted(ConfiguredNode):
    event_driven = {event_driven}

    def __init__(self):
        super().__init__('interrupted')
        self.create_timer(0.01, self.work)

    def setup(self, config):
        if {refuse}:
            raise ValueError('no such board')
        if {slow}:  # as where kernels are compiled
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(3600)

    def work(self):
        os.kill(os.getpid(), signal.{number})
        self.publish_diagnostics()
        print('finished')

    def deactivated(self):
        os.kill(os.getpid(), signal.SIGINT)
        self.publish_diagnostics()
        print('released', flush=True)

    def destroy_node(self):
        while {stuck}:
            time.sleep(3600)
        super().destroy_node()

run_node.__globals__['RELEASE_TIMEOUT_S'] = 0.5 if {stuck} else 20
sys.exit(run_node(Interrupted))
"""
FAST_DDS = 'rmw_fastrtps_cpp'
OPTIONS = {
    'number': 'SIGINT', 'event_driven': False, 'refuse': False, 'slow': False, 'stuck': False,
}  # fmt: skip


def run(folder: Path, *arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-c', SCRIPT.format(**{**OPTIONS, **options}), *arguments],
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
    done = run(tmp_path, number=number, event_driven=event_driven)
    assert done.returncode == 0
    assert [line.partition(': ')[2] for line in done.stderr.splitlines()] == ['active']
    assert done.stdout.splitlines()[0] == 'finished'
    assert done.stdout.splitlines()[-1] == 'released'


def test_an_interrupt_ends_a_node_that_is_still_being_configured(tmp_path: Path) -> None:
    done = run(tmp_path, slow=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')


@pytest.mark.parametrize('event_driven', [False, True])
def test_a_middleware_that_keeps_hold_of_the_node_is_left_behind(
    tmp_path: Path, *, event_driven: bool
) -> None:
    done = run(tmp_path, stuck=True, event_driven=event_driven)
    assert done.returncode == 1
    assert done.stdout.splitlines()[-1] == 'released'
    assert 'in destroy_node' in done.stderr


def test_a_refused_configuration_leaves_the_node_unconfigured(tmp_path: Path) -> None:
    done = run(tmp_path, '--ros-args', '-p', 'qos_dept:=3', refuse=True)
    assert done.returncode == 0  # of the interrupt that its own timer sends
    assert done.stdout.splitlines()[0] == 'finished'
    assert 'released' not in done.stdout
    assert 'no such board' in done.stderr
    assert 'ros2 lifecycle set /interrupted configure' in done.stderr
    assert "'qos_dept' is unknown and ignored; is 'qos_depth' meant?" in done.stderr


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (['-p', 'x:=1'], ': expected --ros-args before parameters'),
        (['--ros-args', '-p', 'x'], "rule: '-p x'; expected -p NAME:=VALUE"),
        (['--ros-args', '--params-file', 'none.yaml'], 'none.yaml'),
    ],
)
def test_wrong_arguments_are_told_in_a_line(
    tmp_path: Path, arguments: list[str], said: str
) -> None:
    done = run(tmp_path, *arguments)
    assert done.returncode == 2
    assert said in done.stderr.splitlines()[-1]
    assert 'Traceback' not in done.stderr
    assert 'lexeme' not in done.stderr.splitlines()[-1]


def test_help_tells_the_parameters_and_starts_nothing(tmp_path: Path) -> None:
    done = run(tmp_path, '--help')
    assert done.returncode == 0
    assert 'qos_depth:=500' in done.stdout
    assert 'Queue depth of publishers and subscriptions, 1 … 100000' in done.stdout
    assert done.stderr == ''


def test_the_middleware_takes_its_settings_from_the_file_the_user_names(tmp_path: Path) -> None:
    """Fast DDS complains of a file that is not there, of ours it does not."""
    environment = {**os.environ, 'ROS_LOG_DIR': str(tmp_path), 'RMW_IMPLEMENTATION': FAST_DDS}
    environment.pop('FASTRTPS_DEFAULT_PROFILES_FILE', None)
    own = {'FASTRTPS_DEFAULT_PROFILES_FILE': str(tmp_path / 'none.xml')}
    for more, complains in (({}, False), (own, True)):
        done = subprocess.run(
            [sys.executable, '-c', SCRIPT.format(**OPTIONS)],
            env={**environment, **more},
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 0
        assert ('XMLPARSER' in done.stdout + done.stderr) == complains
