# SPDX-License-Identifier: Apache-2.0
"""plan: the timetable of the paper's profile, and violations before anything moves."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from chamber_profile.profile.file import load_profile
from imu_workbench.__main__ import main


def test_the_papers_plan_takes_twelve_hours(tmp_path: Path, capsys) -> None:
    paths = {key: tmp_path / f'plan.{key}' for key in ('html', 'csv', 'json')}
    options = [item for key, path in paths.items() for item in (f'--{key}', str(path))]
    assert main(['plan', 'paper_betta2022', *options]) == 0
    shown = capsys.readouterr().out
    assert '12:00:00 in all' in shown
    content = json.loads(paths['json'].read_text())
    assert content['duration_s'] == 43200
    assert content['cycles'] == 4
    rates = {step['rate_c_per_min'] for step in content['steps'] if step['kind'] == 'ramp'}
    assert rates == {2.0, -2.0}
    with paths['csv'].open() as stream:
        rows = list(csv.DictReader(stream))
    time = np.array([float(row['time_s']) for row in rows])
    setpoint = np.array([float(row['temperature_c']) for row in rows])
    assert time[-1] == 43200
    assert setpoint.min() == -10
    assert setpoint.max() == 50
    cold = (setpoint == -10).sum() * 10
    assert cold == pytest.approx(4 * 1800, rel=0.01)
    page = paths['html'].read_text()
    assert 'id="plotly"' in page
    assert 'http' not in page.split('<main')[1].split('<script')[0]


def test_a_campaign_counts_every_orientation(tmp_path: Path) -> None:
    path = tmp_path / 'plan.json'
    assert main(['plan', 'paper_betta2022_campaign', '--json', str(path)]) == 0
    content = json.loads(path.read_text())
    assert content['orientations'] == ['+x', '+y', '+z']
    assert content['duration_s'] >= 3 * 43200
    assert [s['orientation'] for s in content['steps'] if s['kind'] == 'final'] == [
        '+x', '+y', '+z',
    ]  # fmt: skip


def test_violations_of_limits_are_all_named_and_nothing_is_written(tmp_path: Path, capsys) -> None:
    text = load_profile('paper_betta2022').text
    profile = tmp_path / 'hot.yaml'
    profile.write_text(
        text.replace('target_c: 50', 'target_c: 80').replace('target_c: -10', 'target_c: -30')
    )
    page = tmp_path / 'plan.html'
    assert main(['plan', str(profile), '--html', str(page)]) == 2
    complaint = capsys.readouterr().err
    assert 'target_c 80 is outside the limits' in complaint
    assert 'target_c -30 is outside the limits' in complaint
    assert complaint.count('\n') == 1
    assert not page.exists()
