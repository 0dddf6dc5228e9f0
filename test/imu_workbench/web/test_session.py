# SPDX-License-Identifier: Apache-2.0
"""The address of a tab holds all it shows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from urllib.parse import parse_qsl

from imu_workbench.case import Case, case_of_device, with_version
from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.case.view import Place
from imu_workbench.web.session import Session, place_of
from imu_workbench.web.work.device_work import DeviceWork
from imu_workbench.web.work.result_cache import ResultCache
from imu_workbench.web.work.workspace import Workspace


def opened(folder: Path, fitted) -> Workspace:
    """A server that has read the bags and has two versions."""
    workspace = Workspace(ResultCache(BagRoot(folder), folder), folder / 'cases')
    case = case_of_device(folder / 'cases', 'dut2')
    case = with_version(case, None, 'line', 'one', fitted.line.errors())
    case = with_version(case, 'v1', '+ lag', 'two', fitted.lag.errors())
    work = DeviceWork(case, fitted.bags, fitted.prepared, {'v1': fitted.line, 'v2': fitted.lag})
    workspace.devices['dut2'] = work
    return workspace


def test_an_address_brings_back_what_was_looked_at(fitted, tmp_path):
    workspace = opened(tmp_path, fitted)
    session = Session(workspace, {})
    session.settle()
    assert (session.device, session.version_name) == ('dut2', 'v2')
    session.choose_version('v1')
    session.choose_channel('magnetometer', 1)
    session.go_to(Place('dut2_y', 'ramp_up', 2))
    session.candidate = 'icing'
    again = Session(workspace, dict(parse_qsl(session.query().removeprefix('?'))))
    again.settle()
    assert (again.view, again.version_name, again.candidate) == (session.view, 'v1', 'icing')
    session.brush((3.5, 7.25))
    again = Session(workspace, dict(parse_qsl(session.query().removeprefix('?'))))
    assert again.view.window == (3.5, 7.25)
    assert again.view.place is None


def test_an_address_that_lies_leads_to_what_there_is(fitted, tmp_path):
    workspace = opened(tmp_path, fitted)
    query = {'device': 'dut9', 'version': 'v77', 'sensor': 'nose', 'axis': 'q', 'run': 'gone',
             'cycle': 'x', 'window': '9,3'}  # fmt: skip
    session = Session(workspace, query)
    session.settle()
    assert (session.device, session.version_name) == ('dut2', 'v2')
    assert session.view.place is None
    assert session.view.sensor in session.sensors()
    assert place_of({'run': 'a', 'phase': 'nowhere', 'low': '-5'}) == Place('a', None, None, -5.0)


def test_a_tab_begins_where_the_model_fails_most(fitted, tmp_path):
    session = Session(opened(tmp_path, fitted), {'version': 'v1', 'device': 'dut2'})
    session.settle()
    assert session.view.sensor == 'accelerometer'
    assert session.sensors() == ['gyroscope', 'accelerometer', 'magnetometer']
    assert session.earlier_version is None
    session.choose_version('v2')
    assert session.earlier_version is fitted.line


def test_a_tab_says_why_there_is_no_model(tmp_path):
    workspace = Workspace(ResultCache(BagRoot(tmp_path), tmp_path), tmp_path / 'cases')
    session = Session(workspace, {})
    assert 'Reading' in session.nothing_yet
    workspace.opening = False
    assert 'Open bags' in session.nothing_yet
    workspace.devices['dut2'] = DeviceWork(Case(tmp_path, 'dut2'))
    session.settle()
    assert 'No recording of this device is open' in session.nothing_yet
    workspace.devices['dut2'] = replace(workspace.devices['dut2'], problem='There is none.')
    workspace.devices['dut2'].bags = [object()]  # type: ignore[list-item]
    assert session.nothing_yet == 'There is none.'
    workspace.devices['dut2'].problem = ''
    assert 'being compared' in session.nothing_yet
    workspace.reading = 1
    assert session.nothing_yet == 'Reading the recordings …'
    session.version_name = 'v1'
    workspace.devices['dut2'].failed = {'v1'}
    assert session.nothing_yet.startswith('v1 is not compared with the recordings')
