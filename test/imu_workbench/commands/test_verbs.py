# SPDX-License-Identifier: Apache-2.0
"""What every verb keeps: a help line, --json, and a list that needs no library."""

import runpy
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from imu_workbench.__main__ import build_parser, main
from imu_workbench.commands import COMMANDS

ROOT = Path(__file__).resolve().parents[3]


def test_every_verb_keeps_the_contract() -> None:
    for verb, module_name in COMMANDS.items():
        command = import_module(f'imu_workbench.commands.{module_name}')
        assert len(command.HELP.splitlines()) == 1, verb
        assert callable(command.run)
        build_parser(verb)


@pytest.mark.parametrize('verb', sorted(COMMANDS))
def test_help_is_enough(verb: str, capsys) -> None:
    assert main([verb, '--help']) == 0
    shown = capsys.readouterr().out
    assert '--json' in shown
    assert len(shown.splitlines()) > 5


def test_the_version_is_the_packages(capsys) -> None:
    assert main(['--version']) == 0
    assert capsys.readouterr().out == '0.2.0\n'


def test_the_list_of_verbs_needs_no_library() -> None:
    path = ROOT / 'src/imu_workbench/imu_workbench/commands/__init__.py'
    script = f'import runpy; print(*runpy.run_path({str(path)!r})["COMMANDS"])'
    found = subprocess.run(  # -I -S: no site packages at all
        [sys.executable, '-I', '-S', '-c', script], capture_output=True, text=True, check=True
    )
    assert found.stdout.split() == list(COMMANDS)
    assert runpy.run_path(str(path))['COMMANDS'] == COMMANDS
