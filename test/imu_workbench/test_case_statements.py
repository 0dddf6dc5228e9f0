# SPDX-License-Identifier: Apache-2.0
"""A laboratory states itself once per case; a file with a mistake replaces nothing."""

from pathlib import Path

import pytest
from imu_recording.user_error import UserError
from imu_workbench.case_statements import keep_statement, statement_files, statements_of

EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'


def test_statements_are_kept_under_the_name_of_what_they_are(tmp_path: Path) -> None:
    assert statements_of(tmp_path) == (None, None)
    for name, kept in (('laboratory.yaml', 'laboratory.yaml'), ('limits.yaml', 'limits.yaml')):
        content = (EXAMPLES / name).read_bytes()
        assert keep_statement(tmp_path, 'ours.yaml', content) == kept
    laboratory, limits = statements_of(tmp_path)
    assert laboratory is not None
    assert laboratory.text('laboratory', 'country') == 'XX'
    assert limits is not None
    assert [file.name for file in statement_files(tmp_path)] == ['laboratory.yaml', 'limits.yaml']


@pytest.mark.parametrize(
    ('content', 'told'),
    [
        (b'laboratroy: {name: A}', "unknown key 'laboratroy'"),
        (b'limits: {gyroscope: {bias: 3}}', 'limits.gyroscope.bias'),
        (b'a: [', 'ours.yaml'),
    ],
)
def test_a_mistake_is_named_and_what_was_kept_stays(
    tmp_path: Path, content: bytes, told: str
) -> None:
    good = b'laboratory: {name: A}'
    keep_statement(tmp_path, 'laboratory.yaml', good)
    with pytest.raises(UserError, match=r'ours\.yaml') as raised:
        keep_statement(tmp_path, 'ours.yaml', content)
    assert told in str(raised.value)
    assert str(tmp_path) not in str(raised.value)
    assert (tmp_path / 'laboratory.yaml').read_bytes() == good
    assert not (tmp_path / 'limits.yaml').exists()
