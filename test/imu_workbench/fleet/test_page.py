# SPDX-License-Identifier: Apache-2.0
"""Devices on the page of a fleet lead to their case where it is served."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from imu_workbench.__main__ import main
from imu_workbench.case import Case, CaseRecording, saved
from imu_workbench.fleet.page import _url

BAGS = Path(__file__).parents[3] / 'bags'


def case_of(device: str, folder: Path, sources: list[str]) -> Case:
    return saved(Case(folder, device, tuple(CaseRecording(s, Path(s).name) for s in sources)))


@pytest.fixture
def cases(tmp_path: Path) -> Path:
    folder = tmp_path / 'lot=A'
    case = case_of('dut1', folder / 'dut1', [str(BAGS / f'dut1_{axis}') for axis in 'xyz'])
    closed = replace(case.recordings[2], open=False)
    saved(replace(case, recordings=(*case.recordings[:2], closed)))
    case_of('dut9', folder / 'dut9', [str(tmp_path / 'gone')])
    (folder / 'torn').mkdir()
    (folder / 'torn' / 'case.yaml').write_text('schema: [1')
    return tmp_path


def test_the_page_leads_into_the_case_where_it_is_served(cases: Path) -> None:
    home = cases / 'lot=A' / 'dut1'
    at = 'http://127.0.0.1:8080/?token=a%26b'
    assert _url('dut1', str(home), cases, at) == f'{at}&device=dut1'
    assert _url('dut1', str(home), cases, 'http://[::1]:9') == 'http://[::1]:9/?device=dut1'
    assert _url('dut1', str(home), cases, '') == 'lot%3DA/dut1/'
    assert _url('x', str(BAGS), cases, at).endswith('bags/')  # bags are no case
    assert main(['fleet', str(cases), '-o', str(cases / 'out'), '--served', 'here:8080']) == 2
