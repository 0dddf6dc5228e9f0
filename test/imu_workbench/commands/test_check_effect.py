# SPDX-License-Identifier: Apache-2.0
"""check-effect: the catalogue keeps its own contract, and what breaks it is told where."""

from __future__ import annotations

import inspect
import shutil
from pathlib import Path

import pytest
from imu_workbench.__main__ import main
from thermal_comp.effects import EFFECTS

from .asking import OWN, Answer, refuses


@pytest.mark.parametrize('name', sorted(EFFECTS))
def test_every_file_of_the_catalogue_keeps_the_contract(
    name: str, tmp_path: Path, answer: Answer
) -> None:
    own = Path(inspect.getfile(EFFECTS[name]))
    for file in (own, Path(shutil.copy(own, tmp_path))):
        code, content, _ = answer('check-effect', file)
        assert (code, content) == (0, {'effects': {name: []}, 'ok': True})


def test_an_effect_that_breaks_the_contract_is_told_where(tmp_path: Path, answer: Answer) -> None:
    file = tmp_path / 'broken.py'
    file.write_text(OWN.replace('conditions.time /', 'conditions.time[::-1] /'))
    code, content, text = answer('check-effect', file)
    assert code == 3
    assert content['ok'] is False
    assert content['effects']['daily_rhythm']
    assert 'breaks the contract' in text
    file.write_text(OWN.replace("'daily_rhythm'", "'thermal_lag'"))
    code, content, _ = answer('check-effect', file)
    assert code == 3
    assert any('already' in p for p in content['effects']['thermal_lag'])


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        (None, 'no such file'),
        ('x = 1\n', 'no'),
        ('def columns(:\n', 'broken.py'),
        ('import nothing_like_this\n', 'nothing_like_this'),
    ],
)
def test_files_that_hold_no_effect_are_refused(
    tmp_path: Path, answer: Answer, text: str | None, reason: str
) -> None:
    file = tmp_path / 'broken.py'
    if text is not None:
        file.write_text(text)
    assert reason in refuses(answer, 'check-effect', file)


def test_a_check_that_does_not_hold_is_no_bug(tmp_path: Path) -> None:
    effect = tmp_path / 'loose.py'
    effect.write_text(
        'from thermal_comp.effects import Effect\n\n\nclass Loose(Effect):\n    name = "loose"\n'
    )
    assert main(['check-effect', str(effect)]) == 3


def test_an_effect_of_ones_own_is_checked_explained_and_added(
    bag: Path, tmp_path: Path, answer: Answer
) -> None:
    file = tmp_path / 'rhythm.py'
    file.write_text(OWN)
    code, content, text = answer('check-effect', file)
    assert (code, content) == (0, {'effects': {'daily_rhythm': []}, 'ok': True})
    assert 'keeps the contract' in text
    _, content, text = answer('explain', 'daily_rhythm', '--effects', file)
    assert 'a · sin(2πt/P)' in text
    assert content['parameters']['period']['bounds'] == [600.0, 9000.0]
    grown = tmp_path / 'grown.yaml'
    code, _, _ = answer('add', 'daily_rhythm', bag, '--effects', file, '-o', grown)
    assert code == 0
    assert "'daily_rhythm' is not in the catalogue" in refuses(
        answer, 'compare', bag, '--model', grown
    )
