# SPDX-License-Identifier: Apache-2.0
"""Cases as a fleet: the largest error over its noise floor comes first."""

from __future__ import annotations

from pathlib import Path

import pytest
from imu_workbench.case import CASE_FILE, case_of_device, with_found, with_version
from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.fleet import error_text, fleet_rows
from imu_workbench.web.work.result_cache import ResultCache
from imu_workbench.web.work.workspace import Workspace


def errors(**ratios: float) -> dict[str, dict[str, float]]:
    """Errors of sensors at so many times their noise floor [SI unit]."""
    return {s: {'measured': 9.0, 'error': r * 1e-3, 'floor': 1e-3} for s, r in ratios.items()}


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    """A server of three devices, none of which is open."""
    cases = tmp_path / 'cases'
    for device, found in (
        ('calm', errors(gyroscope=1.0, accelerometer=1.01)),
        ('bad', errors(gyroscope=1.0, accelerometer=8.3)),
    ):
        with_version(case_of_device(cases, device), None, 'line per axis', 'a model', found)
    case_of_device(cases, 'new')
    return Workspace(ResultCache(BagRoot(tmp_path), tmp_path), cases)


def test_the_device_that_fails_most_stands_first(workspace):
    rows = fleet_rows(workspace.fleet())
    assert [row.device for row in rows] == ['bad', 'calm', 'new']
    assert rows[0].worst == pytest.approx(8.3)
    assert rows[0].version == 'v1 line per axis'
    assert (error_text(rows[0], 'accelerometer'), error_text(rows[0], 'magnetometer')) == (
        '0.00830 m/s² (8.30 ×)', '–',
    )  # fmt: skip
    assert [row.version for row in rows[2:]] == ['']
    assert [row.verdict for row in rows] == ['', '', '']


def test_each_device_has_its_verdict(workspace):
    (bad,) = [case for case, _ in workspace.fleet() if case.device == 'bad']
    found = {'diagnosis': {'findings': [], 'sensors': {}, 'explanations': []}, 'errors': {}}
    case = with_version(bad, 'v1', '+ thermal lag', 'a model', errors(accelerometer=1.0))
    with_found(case, 'v2', found)
    told = {row.device: row.verdict for row in fleet_rows(workspace.fleet())}
    assert told['bad'] == 'Nothing is missing: what is left is noise.'


def test_a_case_that_has_changed_on_disk_is_read_again_and_a_damaged_one_is_said(workspace):
    (case,) = [case for case, _ in workspace.fleet() if case.device == 'calm']
    with_version(case, 'v1', '+ thermal lag', 'a model', errors(gyroscope=30.0))
    assert fleet_rows(workspace.fleet())[0].device == 'calm'
    (case.folder / CASE_FILE).write_text('nonsense: [', 'utf-8')
    assert [row.device for row in fleet_rows(workspace.fleet())] == ['bad', 'new']
    assert 'not a YAML file' in workspace.notices.messages[0].text
