# SPDX-License-Identifier: Apache-2.0
"""reproduce: the paper's nine runs; no report is replaced unasked."""

from __future__ import annotations

from pathlib import Path

import pytest
from imu_workbench.__main__ import main
from imu_workbench.commands.reproduce import simulated_campaign


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


def test_a_file_of_effects_that_is_not_there_is_refused_before_anything_is_simulated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ['reproduce', 'paper', '--effects', str(tmp_path / 'absent.py')]
    assert main([*call, '-o', str(tmp_path / 'out')]) == 2
    assert 'absent.py: no such file' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()
