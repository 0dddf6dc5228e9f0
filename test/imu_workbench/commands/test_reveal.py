# SPDX-License-Identifier: Apache-2.0
"""reveal: diagnose first, then open the truth; without one it says so."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from imu_workbench.__main__ import main
from imu_workbench.simulate.hidden_effect import BUNDLED_TRUTH_FILE

from .asking import Answer, refuses

SHORT = 'short_20min'


def test_reveal_diagnoses_first_and_then_opens_the_truth(
    bags: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of one of the bundled runs: what all three tell, the tests of the page ask."""
    told = json.loads((bags / BUNDLED_TRUTH_FILE).read_text())
    (tmp_path / BUNDLED_TRUTH_FILE).write_text(json.dumps(told | {'bags': told['bags'][:1]}))
    (tmp_path / told['bags'][0]).symlink_to(bags / told['bags'][0])
    assert main(['reveal', str(tmp_path), '--json', str(tmp_path / 'answer.json')]) == 0
    content = json.loads((tmp_path / 'answer.json').read_text())
    assert content['right']
    assert content['outcome'] == 'named'
    assert content['truth']['name'] in capsys.readouterr().out


@pytest.mark.long
def test_simulate_tells_reveal_what_a_year_has_changed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / 'later'
    options = ['--hide', 'thermal_lag,warm_up', '--magnitude', '5,3', '--sensor', 'gyroscope']
    command = ['simulate', SHORT, *options, '--aged', '--rate', '0.1', '-o', str(folder)]
    assert main(command) == 0
    assert 'slope' not in capsys.readouterr().out
    assert main(['reveal', str(folder), '--json', str(tmp_path / 'answer.json')]) == 0
    said = capsys.readouterr().out
    content = json.loads((tmp_path / 'answer.json').read_text())
    assert [one['name'] for one in content['outcomes']] == ['thermal_lag', 'warm_up']
    ratio = content['truth']['changes']['slope_ratio']['gyroscope']
    assert f'gyroscope: slope × {ratio:.3g}' in said
    assert said.count('hidden:') == 2


def test_reveal_needs_a_secret(tmp_path: Path, answer: Answer) -> None:
    assert 'no truth here' in refuses(answer, 'reveal', tmp_path)
    assert 'no' in refuses(answer, 'reveal', tmp_path / 'nowhere')
    truth = tmp_path / '.truth.json'
    for text in ('{"schema": 1', '[]', '{}'):
        truth.write_text(text)
        assert str(truth) in refuses(answer, 'reveal', tmp_path)


def test_results_of_a_fleet_belong_to_a_simulated_fleet(tmp_path: Path, answer: Answer) -> None:
    line = refuses(answer, 'reveal', tmp_path, '--fleet', tmp_path / 'results')
    assert 'no fleet was simulated here; leave --fleet away' in line
