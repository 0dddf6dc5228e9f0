# SPDX-License-Identifier: Apache-2.0
"""The command line itself: exit codes, mistyped words, closed and plain terminals, old outputs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from imu_workbench.__main__ import main
from imu_workbench.commands import COMMANDS
from imu_workbench.commands.reproduce import simulated_campaign
from thermal_comp.presentation.diagnosis import VERDICTS
from thermal_comp.presentation.words import WORDS

WORKBENCH = [sys.executable, '-m', 'imu_workbench']


def test_a_mistyped_verb_or_effect_is_guessed(capsys: pytest.CaptureFixture[str]) -> None:
    for argv, guess in (
        (['dignose', 'bag'], 'did you mean diagnose?'),
        (['explain', 'termal_lag'], 'did you mean thermal_lag?'),
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


@pytest.mark.parametrize('word', [*sorted({*VERDICTS, *WORDS})])
def test_every_word_of_an_answer_is_explained(
    word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['explain', word]) == 0
    assert capsys.readouterr().out.startswith(f'{word}: ')


def test_a_check_that_does_not_hold_is_no_bug(tmp_path: Path) -> None:
    effect = tmp_path / 'loose.py'
    effect.write_text(
        'from thermal_comp.effects import Effect\n\n\nclass Loose(Effect):\n    name = "loose"\n'
    )
    assert main(['check-effect', str(effect)]) == 3


def test_nothing_that_exists_is_replaced_unasked(
    bags: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, bag = tmp_path / 'm.yaml', tmp_path / 'bag'
    model.write_text('mine')
    bag.mkdir()
    (bag / 'thesis.tex').write_text('mine')
    dut, simulate = str(bags / 'dut1_x'), ['simulate', 'short_20min', '--rate', '0.1']
    for argv in (
        ['fit', dut, '-o', str(model)],
        ['auto', dut, '-o', str(model)],
        ['add', 'thermal_lag', dut, '-o', str(model)],
        ['report', dut, '-o', str(model)],
        [*simulate, '--orientation', 'x', '-o', str(bag)],
        [*simulate, '--orientation', 'x', '-o', str(bag), '--force'],
    ):
        assert main(argv) == 2
        assert str(tmp_path) in capsys.readouterr().err
    assert model.read_text() == 'mine'
    assert [path.name for path in bag.iterdir()] == ['thesis.tex']
    assert main(['fit', dut, '-o', str(model), '--force']) == 0
    assert model.read_text().startswith('schema: 1')
    for force in ([], ['--force']):
        argv = [*simulate, '--orientation', 'x', '-o', str(tmp_path / 'run'), *force]
        assert main(argv) == 0


def test_a_plain_or_closed_terminal_is_no_traceback() -> None:
    explain = [*WORKBENCH, 'explain', 'thermal_lag']
    plain = {**os.environ, 'PYTHONIOENCODING': 'ascii'}
    found = subprocess.run(explain, capture_output=True, env=plain, check=False)
    assert (found.returncode, found.stderr) == (0, b'')
    assert b'error = a ?' in found.stdout
    for command in (f'{" ".join(explain)} >&-', f'{" ".join([*WORKBENCH, "--help"])} | true'):
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


def test_an_import_shows_the_ranges_and_refuses_another_unit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, mapping = tmp_path / 'a.csv', tmp_path / 'm.yaml'
    table.write_text('t,a,b,c,T\n' + ''.join(f'{k},0,0,1,{20 + k / 50}\n' for k in range(200)))
    told = (
        'schema: 1\ntime: {{column: t}}\ncolumns:\n  temperature: {{column: T}}\n'
        '  linear_acceleration: {{columns: [a, b, c]{}}}\n'
    )
    argv = ['import', str(table), '--mapping', str(mapping), '-o', str(tmp_path / 'bag')]
    mapping.write_text(told.format(''))
    assert main(argv) == 2
    assert 'as if in g' in capsys.readouterr().err
    mapping.write_text(told.format(', unit: g'))
    assert main(argv) == 0
    words = capsys.readouterr().out.split()
    at = words.index('temperature')
    assert words[at : at + 5] == ['temperature', '20.0', '22.0', '24.0', '°C']


def test_the_papers_campaign_is_nine_runs_under_their_names() -> None:
    runs = simulated_campaign('short_20min', 1.0)
    assert [run.run for run in runs] == [f'dut{k}_{axis}' for k in (1, 2, 3) for axis in 'xyz']
    assert [run.up_axis for run in runs[:3]] == ['+x', '+y', '+z']
    assert len(runs[0]) == pytest.approx(2 * len(runs[1]), abs=20)


def test_reproduce_replaces_no_report_unasked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'report.html').write_text('mine')
    assert main(['reproduce', 'paper', '-o', str(tmp_path)]) == 2
    assert 'report.html exists already' in capsys.readouterr().err
    assert main(['reproduce', 'paper', '--rate', '0', '-o', str(tmp_path / 'x')]) == 2
