# SPDX-License-Identifier: Apache-2.0
"""Faults of emulators as the command line gives them."""

import pytest
from chamber_profile.emulators.faults import Fault, parse_fault


@pytest.mark.parametrize('text', ['silence', 'coffee@3', 'silence@', 'silence@-3', 'silence@3+'])
def test_a_fault_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match='NAME@SECONDS'):
        parse_fault(text)


def test_faults_last_until_the_end_unless_told_otherwise() -> None:
    assert parse_fault('garbage@3') == Fault('garbage', 3.0)
    assert parse_fault('half-line@3+4') == Fault('half_line', 3.0, 4.0)
