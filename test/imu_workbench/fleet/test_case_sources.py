# SPDX-License-Identifier: Apache-2.0
"""Cases as sources of a fleet, beside folders, lists and URLs that are not local."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import fsspec
import pytest
from imu_workbench.case import Case, CaseRecording, saved
from imu_workbench.fleet.engine import Cluster, run_fleet
from imu_workbench.fleet.estimate import Settings
from imu_workbench.fleet.sources import find_devices
from imu_workbench.fleet.table import FleetTable

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


def test_a_case_is_a_device_with_the_recordings_that_are_open(cases: Path) -> None:
    ticks = itertools.count(10**12, 3 * 10**9)
    devices = find_devices([str(cases), str(BAGS / 'dut1_x')])
    assert len(devices) == 3  # the bag belongs to its case
    (whole,) = (device for device in devices if device.device == 'dut1')
    assert [Path(bag).name for bag in whole.bags] == ['dut1_x', 'dut1_y']
    assert whole.lot == 'A'
    assert whole.case == str(cases / 'lot=A' / 'dut1')
    out = cases / 'out'
    here = Cluster(workers=1, processes=False)
    done = run_fleet(devices, out, Settings(), here, clock=lambda: next(ticks))
    assert done.estimated == 1
    assert f'its recording {cases / "gone"} is not there' in done.failed['dut9']
    assert 'not a YAML file' in done.failed['torn']
    rows = FleetTable(out).rows("SELECT DISTINCT device FROM results WHERE role = 'fitted'")
    assert rows == [('dut1',)]
    again = run_fleet(devices, out, Settings(), here, clock=lambda: next(ticks))
    assert (again.estimated, again.unchanged, len(again.failed)) == (0, 1, 2)


def test_cases_and_bags_of_another_file_system(cases: Path) -> None:
    files = fsspec.filesystem('memory')
    files.put(str(BAGS / 'dut1_x'), '/site/type=LSM/lot=B/dut1/dut1_x', recursive=True)
    case = cases / 'lot=A' / 'dut1' / 'case.yaml'
    files.pipe('/site/cases/dut1/case.yaml', case.read_bytes())
    try:
        (bag,) = find_devices(['memory://site/type=LSM'])
        assert (bag.device, bag.lot, bag.type) == ('dut1', 'B', 'LSM')
        (far,) = find_devices(['memory://site/cases'])
        assert far.case == 'memory:///site/cases/dut1'
        assert [Path(one).name for one in far.bags] == ['dut1_x', 'dut1_y']
    finally:
        files.rm('/site', recursive=True)
