# SPDX-License-Identifier: Apache-2.0
"""Sources of a fleet: folders, lists, globs, URLs that are not local, and cases."""

from __future__ import annotations

import errno
import itertools
import os
import shutil
from dataclasses import replace
from pathlib import Path

import fsspec
import pytest
import yaml
from fsspec.implementations.local import LocalFileSystem
from imu_recording.user_error import UserError
from imu_workbench.case import Case, CaseRecording, saved
from imu_workbench.fleet.engine import Cluster, run_fleet
from imu_workbench.fleet.estimate import EstimateSettings
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


@pytest.mark.long
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
    done = run_fleet(devices, out, EstimateSettings(), here, clock=lambda: next(ticks))
    assert done.estimated == 1
    assert f'its recording {cases / "gone"} is not there' in done.failed['dut9']
    assert 'not a YAML file' in done.failed['torn']
    rows = FleetTable(out).rows("SELECT DISTINCT device FROM results WHERE role = 'fitted'")
    assert rows == [('dut1',)]
    again = run_fleet(devices, out, EstimateSettings(), here, clock=lambda: next(ticks))
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


@pytest.mark.parametrize(
    ('content', 'said'),
    [
        (None, 'Permission denied; make it readable'),
        ('schema: 1\ndevice: 2024-13-45', 'not a YAML file'),
        ('- 1', 'expected 1'),
        ('recordings: [{source: 5, run: r}]', 'source 5 is no path'),
        ('recordings: ["x"]', 'TypeError'),
        ("recordings: [{source: 'nosuch://x', run: r}]", 'nosuch'),
    ],
)
def test_a_case_that_cannot_be_read_is_a_device_with_that_reason(
    cases: Path, monkeypatch: pytest.MonkeyPatch, content: str | None, said: str
) -> None:
    file = cases / 'lot=A' / 'dut9' / 'case.yaml'
    whole = yaml.safe_load(file.read_text())
    if content is None:
        read = LocalFileSystem.cat_file

        def refused(files: LocalFileSystem, path: str, **options: object) -> bytes:
            if path == str(file):  # root may read everything
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), path)
            return bytes(read(files, path, **options))

        monkeypatch.setattr(LocalFileSystem, 'cat_file', refused)
    elif content.startswith('recordings'):
        file.write_text(yaml.safe_dump(whole | yaml.safe_load(content)))
    else:
        file.write_text(content)
    problems = {Path(one.case).name: one.problem for one in find_devices([str(cases)])}
    assert problems['dut1'] == ''
    assert said in problems['dut9']


@pytest.mark.parametrize('custom', ['    - dut1', '    device: 2024-13-45', '    {', '    dut1'])
def test_metadata_without_a_mapping_names_nobody(tmp_path: Path, custom: str) -> None:
    bag = tmp_path / 'unit [7]' / 'x'
    shutil.copytree(BAGS / 'dut1_x', bag)
    file = bag / 'metadata.yaml'
    head, found, _ = file.read_text().partition('  custom_data:\n')
    assert found
    file.write_text(f'{head}{found}{custom}\n')
    (device,) = find_devices([str(tmp_path / 'unit [7]')])
    assert (device.device, device.bags) == ('', (str(bag),))


def copied(fleet_bags: Path, device: str, target: Path) -> Path:
    shutil.copytree(fleet_bags / device, target)
    return target


def test_a_list_that_leads_to_itself_is_a_problem_and_no_endless_search(
    fleet_bags: Path, tmp_path: Path
) -> None:
    one, two = tmp_path / 'one.txt', tmp_path / 'two.txt'
    one.write_text(f'{two}\n{fleet_bags}/lot=B\n')
    two.write_text(f'{one}\n')
    devices = find_devices([str(one)])
    (round_trip,) = [d for d in devices if d.problem]
    assert f'{one} → {two} → {one}' in round_trip.problem
    assert any(d.bags for d in devices)


def test_sources_are_globs_lists_and_urls(fleet_bags: Path, tmp_path: Path) -> None:
    listed = tmp_path / 'list.csv'
    listed.write_text(
        f'source,lot,type\n{fleet_bags}/lot=A/A00001,Q,LSM\nfile://{fleet_bags}/lot=B,,\n'
    )
    devices = find_devices([str(listed), f'{fleet_bags}/lot=A/A0000?'])
    assert [(d.device, d.lot, d.type) for d in devices] == [
        ('A00002', 'A', 'none'), ('B00003', 'B', 'none'), ('A00001', 'Q', 'LSM'),
    ]  # fmt: skip
    assert all(len(device.bags) == 3 for device in devices)
    with pytest.raises(UserError, match='no bag here'):
        find_devices([str(tmp_path / 'nowhere')])
    listed.write_text(f'source\n{fleet_bags}/lot=B\n{tmp_path}/gone\n')
    missing, found = sorted(find_devices([str(listed)]), key=lambda device: device.device)
    assert found.device == 'B00003'
    assert 'gone: no bag here' in missing.problem
    listed.write_text('path\nx\n')
    with pytest.raises(UserError, match='a list has source'):
        find_devices([str(listed)])


def test_a_bag_that_names_nobody_belongs_to_its_neighbour(
    fleet_bags: Path, tmp_path: Path
) -> None:
    folder = copied(fleet_bags, 'lot=A/A00001', tmp_path / 'A00001')
    (folder / 'z' / 'metadata.yaml').unlink()
    (device,) = find_devices([str(tmp_path)])
    assert (device.device, len(device.bags)) == ('A00001', 3)


def test_a_folder_that_may_not_be_read_is_a_device_with_that_reason(
    fleet_bags: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copied(fleet_bags, 'lot=A/A00001', tmp_path / 'A00001')
    # Root may read everything.
    monkeypatch.setattr(os, 'access', lambda path, mode: not str(path).endswith('A00001/y'))
    (device,) = find_devices([str(tmp_path)])
    assert device.problem == f'{tmp_path}/A00001/y: no permission to read it'
    (device,) = find_devices([str(tmp_path / 'A00001' / 'y')])
    assert device.problem
