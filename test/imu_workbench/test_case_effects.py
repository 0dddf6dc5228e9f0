# SPDX-License-Identifier: Apache-2.0
"""Effect files kept in a case: their content, and which load without asking."""

from __future__ import annotations

from pathlib import Path

import pytest
from imu_workbench.case import CaseError, case_of_device, load_case
from imu_workbench.case_effects import (
    allow,
    allowed_in,
    digest,
    effect_file,
    kept_effects,
    with_effect_file,
)


def test_an_effect_file_stays_in_the_case_when_its_path_is_gone(tmp_path: Path):
    file = tmp_path / 'my_effect.py'
    file.write_text('"""An effect."""\n', 'utf-8')
    case = with_effect_file(case_of_device(tmp_path / 'cases', 'dut2'), file)
    key = digest(file.read_bytes())
    file.unlink()
    again = load_case(case.folder)
    assert kept_effects(again) == {key: 'my_effect.py'}
    assert effect_file(again, key) == b'"""An effect."""\n'


def test_two_files_of_one_name_are_kept_side_by_side(tmp_path: Path):
    case = case_of_device(tmp_path / 'cases', 'dut2')
    file = tmp_path / 'my_effect.py'
    for text in ('first = 1\n', 'second = 2\n', 'first = 1\n'):
        file.write_text(text, 'utf-8')
        case = with_effect_file(case, file)
    assert [effect_file(case, key) for key in kept_effects(case)] == [
        b'first = 1\n', b'second = 2\n',
    ]  # fmt: skip


def test_a_kept_file_that_was_changed_is_refused(tmp_path: Path):
    file = tmp_path / 'my_effect.py'
    file.write_text('harmless = 1\n', 'utf-8')
    case = with_effect_file(case_of_device(tmp_path / 'cases', 'dut2'), file)
    (key,) = kept_effects(case)
    kept = next((case.folder / 'effects').rglob('*.py'))
    kept.write_text('harmful = 1\n', 'utf-8')
    with pytest.raises(CaseError, match='not the file that was kept'):
        effect_file(case, key)
    kept.unlink()
    with pytest.raises(CaseError, match='put it back'):
        effect_file(case, key)


def test_only_what_was_given_here_is_allowed_to_run_by_itself(tmp_path: Path):
    assert allowed_in(tmp_path) == []
    allow(tmp_path, 'a' * 64)
    allow(tmp_path, 'a' * 64)
    assert allowed_in(tmp_path) == ['a' * 64]
