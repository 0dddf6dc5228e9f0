# SPDX-License-Identifier: Apache-2.0
"""A user's YAML file against a schema: one line that names file, field and mistake."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import pytest
from imu_recording.user_error import UserError
from imu_workbench.report.checked_yaml import json_like, read_checked

GOOD = 'thermometer: {expanded_uncertainty: 0.2, calibrated: 2026-01-15}\n'


def test_dates_are_text_wherever_they_stand() -> None:
    day = dt.date(2026, 1, 15)
    assert json_like({1: [day, {'due': day}], 'x': 2.5}) == {
        '1': ['2026-01-15', {'due': '2026-01-15'}],
        'x': 2.5,
    }


def test_a_file_that_keeps_the_schema_is_returned_as_it_is(tmp_path: Path) -> None:
    file = tmp_path / 'laboratory.yaml'
    file.write_text(GOOD)
    assert read_checked(file, 'laboratory.json') == {
        'thermometer': {'expanded_uncertainty': 0.2, 'calibrated': '2026-01-15'}
    }


@pytest.mark.parametrize(
    ('content', 'said'),
    [
        (b'thermometre: {}\n', "the file: unknown key 'thermometre' (did you mean thermometer?)"),
        (b'thermometer: {expanded_uncertainty: cold}\n', 'thermometer.expanded_uncertainty: '),
        (b'thermometer: [\n', 'line'),
        (b'- a list\n', 'the file: '),
        (b'operator: \xff\xfe\xff\n', 'is no text in UTF-8'),
    ],
)
def test_a_mistake_is_named_with_its_place(tmp_path: Path, content: bytes, said: str) -> None:
    file = tmp_path / 'laboratory.yaml'
    file.write_bytes(content)
    with pytest.raises(UserError) as refused:
        read_checked(file, 'laboratory.json')
    assert str(refused.value).startswith(f'{file}: ')
    assert said in str(refused.value)
    assert '\n' not in str(refused.value)
