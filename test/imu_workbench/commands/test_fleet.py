# SPDX-License-Identifier: Apache-2.0
"""fleet: workers, the page, and the one line that refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from imu_workbench.__main__ import main
from imu_workbench.fleet import engine
from imu_workbench.fleet.table import FleetTable

from .asking import OWN


@pytest.mark.end_to_end
def test_the_verb_starts_workers_and_writes_the_page(fleet_bags: Path, tmp_path: Path) -> None:
    out, answer = tmp_path / 'out', tmp_path / 'answer.json'
    call = [
        'fleet',
        f'{fleet_bags}/lot=B',
        '-o',
        str(out),
        '--workers',
        '1',
        '--json',
        str(answer),
    ]
    assert main(call) == 0
    assert json.loads(answer.read_text())['run']['estimated'] == 1
    assert json.loads((out / 'study.json').read_text())['devices'] == 1
    assert '<title>Fleet</title>' in (out / 'report.html').read_text()


@pytest.mark.long
@pytest.mark.end_to_end
def test_workers_try_an_effect_of_the_users_own(fleet_bags: Path, tmp_path: Path) -> None:
    effect, out = tmp_path / 'rhythm.py', tmp_path / 'out'
    effect.write_text(OWN)
    call = ['fleet', f'{fleet_bags}/lot=B', '-o', str(out), '--workers', '1']
    assert main([*call, '--effects', str(effect)]) == 0
    tried = "SELECT DISTINCT effect FROM results WHERE role = 'candidate'"
    assert ('daily_rhythm',) in FleetTable(out).rows(tried)


def test_mistakes_are_one_line(
    fleet_bags: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(engine, 'CONNECT_TIMEOUT_S', 0.2)
    call = ['fleet', str(fleet_bags), '-o', str(tmp_path / 'out')]
    assert main(['reveal', str(fleet_bags), '--fleet', str(tmp_path)]) == 2
    assert 'no results here' in capsys.readouterr().err
    assert main([*call, '--scheduler', 'tcp://127.0.0.1:9']) == 2
    assert 'no answer' in capsys.readouterr().err
    for option, value in (('--workers', '0'), ('--memory', 'lots'), ('--memory', '5')):
        assert main([*call, option, value]) == 2
        assert f'{option} {value}' in capsys.readouterr().err
    absent = tmp_path / 'absent.py'
    assert main([*call, '--effects', str(absent)]) == 2
    assert f'{absent}: no such file' in capsys.readouterr().err
    monkeypatch.setattr('imu_workbench.fleet.LIBRARIES', ())
    monkeypatch.setattr('imu_workbench.fleet.find_spec', lambda name: None)
    assert main(call) == 2
    assert 'requirements-fleet.txt' in capsys.readouterr().err
