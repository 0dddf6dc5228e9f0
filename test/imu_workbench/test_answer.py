# SPDX-License-Identifier: Apache-2.0
"""The front end's contract: plain JSON, one line and exit 2 for the user's mistakes."""

import argparse
import json
import subprocess
import sys
import types
from pathlib import Path

import imu_workbench.__main__ as front_end
import numpy as np
import pytest
from imu_recording.recording import BagError
from imu_recording.ros.parameter import ParameterError
from imu_recording.tables.mapping import MappingError
from imu_recording.user_error import UserError
from imu_workbench.answer import Answer, plain, write_json


def install(monkeypatch: pytest.MonkeyPatch, run: object) -> None:
    """Make `probe BAG` a verb whose work is `run`."""
    command = types.SimpleNamespace(
        HELP='Probe the front end.',
        arguments=lambda parser: parser.add_argument('bag'),
        run=run,
    )
    monkeypatch.setattr(front_end, 'COMMANDS', {'probe': 'probe'})
    monkeypatch.setattr(front_end, 'import_module', lambda name: command)


def test_answer_goes_to_terminal_and_json(monkeypatch, tmp_path: Path, capsys) -> None:
    def run(options: argparse.Namespace) -> Answer:
        content = {'bag': options.bag, 'rms': np.array([1.5, np.nan]), 'n': np.int32(3)}
        return Answer(content, 'three samples', exit_code=1)

    install(monkeypatch, run)
    target = tmp_path / 'answer.json'
    assert front_end.main(['probe', 'x', '--json', str(target)]) == 1
    assert capsys.readouterr().out == 'three samples\n'
    assert json.loads(target.read_text()) == {'bag': 'x', 'rms': [1.5, None], 'n': 3}


@pytest.mark.parametrize(
    ('error', 'line'),
    [
        (UserError('rate is −1,\nexpected more than 0'), 'rate is −1, expected more than 0'),
        (FileNotFoundError(2, 'No such file or directory', 'a.yaml'), 'a.yaml: No such file'),
    ],
)
def test_a_mistake_is_one_line_and_exit_2(monkeypatch, capsys, error, line) -> None:
    def run(options: argparse.Namespace) -> Answer:
        raise error

    install(monkeypatch, run)
    assert front_end.main(['probe', 'x']) == 2
    shown = capsys.readouterr()
    assert shown.err.count('\n') == 1
    assert line in shown.err
    assert not shown.out


@pytest.mark.parametrize('error', [BagError, MappingError, ParameterError])
def test_the_projects_errors_have_one_root(error: type[Exception]) -> None:
    assert issubclass(error, UserError)
    assert issubclass(error, ValueError)


@pytest.mark.parametrize(
    'bug',
    [
        KeyError('gyroscope'),
        ValueError('operands could not be broadcast together'),
        FileNotFoundError(2, 'No such file', str(Path(front_end.__file__).parent / 'page.html')),
    ],
)
def test_a_bug_is_no_mistake_of_the_user(monkeypatch, bug: Exception) -> None:
    def run(options: argparse.Namespace) -> Answer:
        raise bug

    install(monkeypatch, run)
    with pytest.raises(type(bug)):
        front_end.main(['probe', 'x'])


def test_a_bug_ends_the_process_with_1_and_a_traceback() -> None:
    script = (
        'import sys, imu_workbench.__main__ as f; from imu_workbench.commands import explain; '
        "explain.run = lambda options: int('bug'); "
        "sys.exit(f.main(['explain', 'thermal_lag']))"
    )
    found = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True, check=False
    )
    assert found.returncode == 1
    assert found.stderr.startswith('Traceback')
    assert not found.stdout


@pytest.mark.parametrize(
    'argv', [[], ['nonsense'], ['probe'], ['probe', 'x', '--json', '/nowhere/a.json']]
)
def test_wrong_arguments_are_one_line(monkeypatch, capsys, argv) -> None:
    install(monkeypatch, lambda options: Answer({}, ''))
    assert front_end.main(argv) == 2
    assert capsys.readouterr().err.count('\n') == 1


def test_the_executable_names_the_verb(monkeypatch, capsys) -> None:
    install(monkeypatch, lambda options: Answer({}, f'probed {options.bag}'))
    monkeypatch.setattr('sys.argv', ['/opt/lib/imu_workbench/probe', 'bag7'])
    assert front_end.run_verb() == 0
    assert capsys.readouterr().out == 'probed bag7\n'


def test_plain_refuses_what_json_cannot_hold(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match='object'):
        plain({'a': object()})
    write_json({'σ': 0.5}, tmp_path / 'a.json')
    assert 'σ' in (tmp_path / 'a.json').read_text('utf-8')
