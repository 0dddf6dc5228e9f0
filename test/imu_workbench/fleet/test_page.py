# SPDX-License-Identifier: Apache-2.0
"""Devices on the page of a fleet lead to their case where it is served."""

from __future__ import annotations

from pathlib import Path

import pytest
from imu_workbench.__main__ import main
from imu_workbench.case import Case, CaseRecording, saved
from imu_workbench.fleet.page import _url

BAGS = Path(__file__).parents[3] / 'bags'


@pytest.fixture
def cases(tmp_path: Path) -> Path:
    """Return the folder of the case of one device of a lot."""
    saved(Case(tmp_path / 'lot=A' / 'dut1', 'dut1', (CaseRecording(str(BAGS / 'dut1_x'), 'x'),)))
    return tmp_path


def test_the_page_leads_into_the_case_where_it_is_served(cases: Path) -> None:
    home = cases / 'lot=A' / 'dut1'
    at = 'http://127.0.0.1:8080/?token=a%26b'
    assert _url('dut1', str(home), cases, at) == f'{at}&device=dut1'
    assert _url('dut1', str(home), cases, 'http://[::1]:9') == 'http://[::1]:9/?device=dut1'
    assert _url('dut1', str(home), cases, '') == 'lot%3DA/dut1/'
    assert _url('x', str(BAGS), cases, at).endswith('bags/')  # bags are no case
    assert main(['fleet', str(cases), '-o', str(cases / 'out'), '--served', 'here:8080']) == 2
