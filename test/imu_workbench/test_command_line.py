# SPDX-License-Identifier: Apache-2.0
"""The command line itself: exit codes, mistyped words, closed and plain terminals."""

from __future__ import annotations

import ast
import contextlib
import os
import pty
import signal
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest
from imu_recording.recording import PHASES
from imu_workbench.__main__ import main
from imu_workbench.commands import COMMANDS
from imu_workbench.report.claims.claim import VERDICT_NAMES
from orientation_filters.filters import FILTERS, PARAMETERS
from thermal_comp.compensation.stream import Condition
from thermal_comp.data.conditions import CHANNELS
from thermal_comp.diagnosis.explanations import FINDINGS
from thermal_comp.effects import EFFECTS
from thermal_comp.presentation.comparison import COLUMN_TITLES
from thermal_comp.presentation.diagnosis import VERDICTS
from thermal_comp.presentation.words import VERDICT_SENTENCES

ROOT = Path(__file__).resolve().parents[2]
WORKBENCH = [sys.executable, '-m', 'imu_workbench']


def test_a_mistyped_verb_or_effect_is_guessed(
    bags: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for argv, guess in (
        (['dignose', 'bag'], 'did you mean diagnose?'),
        (['explain', 'termal_lag'], 'did you mean thermal_lag?'),
        (['explain', 'lag'], 'did you mean thermal_lag?'),
        (['simulate', 'short_20_min', '-o', 'x'], 'did you mean short_20min?'),
        (
            ['replay', str(bags / 'dut1_x'), '--node', 'ahrs', '-o', 'x'],
            'did you mean ahrs_filter?',
        ),
        (['add', 'thermal_lagg', 'bag', '-o', 'm.yaml'], 'did you mean thermal_lag?'),
        (['simulate', 'short_20min', '--hide', 'wrm_up', '-o', 'x'], 'did you mean warm_up?'),
    ):
        assert main(argv) == 2
        told = capsys.readouterr().err
        assert guess in told
        assert told.count('\n') == 1


def test_every_verb_is_listed_with_a_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['--help']) == 0
    listed = capsys.readouterr().out
    for verb in COMMANDS:
        assert f'\n    {verb}' in listed


def words_of_answers() -> set[str]:
    """Return every word of verbs and nodes that one of their own lists holds."""
    tables = 'imu_workbench/tables'
    found_in_tables = {
        node.args[0].value
        for path in (ROOT / 'src/imu_workbench' / tables).glob('*.py')
        for node in ast.walk(ast.parse(path.read_text('utf-8')))
        if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == 'TableFinding'
        if isinstance(node.args[0], ast.Constant)
    }
    presets = {name for kind in PARAMETERS.values() for name in kind.presets}
    counted = {item.name for item in fields(Condition)} - {'samples', 'temperature'}
    shapes = {item.name for effect in EFFECTS.values() for item in fields(effect)}
    return {
        *EFFECTS, *shapes, *FINDINGS, *VERDICTS, *VERDICT_NAMES.values(), *COLUMN_TITLES,
        *COLUMN_TITLES.values(), *PHASES, *CHANNELS, *FILTERS, *presets, *counted,
        *found_in_tables, *VERDICT_SENTENCES,
    }  # fmt: skip


@pytest.mark.long
def test_every_word_of_an_answer_is_explained(capsys: pytest.CaptureFixture[str]) -> None:
    words = words_of_answers()
    assert len(words) > 100
    unknown = [word for word in sorted(words) if main(['explain', word])]
    assert unknown == [], capsys.readouterr().err
    assert main(['explain', 'Held out']) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith('held_out')


LONG_VERBS = (
    ['simulate', 'paper_betta2022', '--rate', '20', '-o', '{out}'],
    pytest.param(
        ['auto', '{bags}/dut1_x', '{bags}/dut1_y', '-o', '{out}.yaml'], marks=pytest.mark.long
    ),
    ['report', '{bags}/dut1_x', '{bags}/dut1_y', '-o', '{out}.html'],
)


@pytest.mark.parametrize('verb', LONG_VERBS, ids=lambda verb: verb[0])
def test_ctrl_c_leaves_no_traceback(verb: list[str], bags: Path, tmp_path: Path) -> None:
    argv = [word.format(bags=bags, out=tmp_path / 'out') for word in verb]
    terminal, end = pty.openpty()
    with subprocess.Popen(
        [*WORKBENCH, *argv], stdin=end, stdout=end, stderr=end, start_new_session=True
    ) as child:
        os.close(end)
        told = b''
        while '…'.encode() not in told:  # its first line of progress
            told += os.read(terminal, 1024)
        os.killpg(child.pid, signal.SIGINT)  # as a terminal sends it, to the workers, too
        with contextlib.suppress(OSError):  # a closed pseudo-terminal
            while part := os.read(terminal, 1024):
                told += part
        # Where the signal meets the very end of Python itself, that dies of it: −SIGINT.
        assert child.wait() in {130, -signal.SIGINT}, told.decode()
    os.close(terminal)
    assert 'Traceback' not in told.decode()
    assert told.decode().rstrip().endswith(f'{verb[0]}: interrupted')
    assert not list(tmp_path.iterdir())


def test_ctrl_c_that_meets_a_callback_of_python_is_not_lost() -> None:
    """What a weak reference calls may raise nothing: Python says so and goes on."""
    program = """
import select, signal, sys, weakref
from imu_workbench import __main__ as workbench

class Dropped:
    pass

def main(argv):
    dropped = Dropped()
    ended = weakref.ref(dropped, lambda _: signal.raise_signal(signal.SIGINT))
    del dropped
    select.select([], [], [], 60.0)

workbench._answer = main
sys.exit(workbench.run_process(['explain', 'residual']))
"""
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, check=False)
    assert (done.returncode, done.stderr.decode()) == (130, 'explain: interrupted\n')


def test_a_plain_or_closed_terminal_is_no_traceback() -> None:
    explain = [*WORKBENCH, 'explain', 'thermal_lag']
    plain = {**os.environ, 'PYTHONIOENCODING': 'ascii'}
    found = subprocess.run(explain, capture_output=True, env=plain, check=False)
    assert (found.returncode, found.stderr) == (0, b'')
    assert b'error = a ?' in found.stdout
    for command in (f'{" ".join(explain)} >&-', f'{" ".join([*explain, "--help"])} | true'):
        done = subprocess.run(['bash', '-c', command], capture_output=True, check=False)
        assert (done.returncode, done.stderr) == (0, b''), command


def test_a_fault_in_yaml_is_told_with_its_line(
    bags: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / 'broken.yaml'
    broken.write_text('schema: 1\ndevice: [dut1\nsensors: 3\n')
    table = tmp_path / 'table.csv'
    table.write_text('t,a\n1,2\n')
    for argv in (
        ['compare', str(bags / 'dut1_x'), '--model', str(broken)],
        ['import', str(table), '--mapping', str(broken), '-o', str(tmp_path / 'o')],
        ['plan', str(broken)],
    ):
        assert main(argv) == 2
        assert f'{broken}' in (told := capsys.readouterr().err)
        assert 'line 3' in told
