# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from imu_workbench.web.case.view import View
from imu_workbench.web.session import DeviceState, Session


def test_versions_are_a_line_that_undo_walks_back(fitted):
    state = DeviceState('dut2', fitted.bags, fitted.prepared, [fitted.line])
    state.append(fitted.lag)
    assert (state.current, state.earlier_version) == (1, fitted.line)
    state.current = 0
    state.append(fitted.line)
    assert len(state.versions) == 2
    state.undo()
    state.undo()
    assert (state.versions, state.current, state.earlier) == ([fitted.line], 0, None)


def test_a_tab_says_why_there_is_no_model(fitted):
    session = Session()
    assert 'Open bags' in session.nothing_yet
    session.devices['dut2'] = DeviceState('dut2', fitted.bags, fitted.prepared)
    session.device = 'dut2'
    assert 'being fitted' in session.nothing_yet
    session.devices['dut2'].problem = 'There is none.'
    assert session.nothing_yet == 'There is none.'


def test_a_tab_begins_where_the_model_fails_most(fitted):
    state = DeviceState('dut2', fitted.bags, fitted.prepared, [fitted.line])
    session = Session({'dut2': state}, 'dut2', View('gyroscope'))
    session.look_at_worst()
    assert session.view.sensor == 'accelerometer'
    assert session.sensors() == ['gyroscope', 'accelerometer', 'magnetometer']
