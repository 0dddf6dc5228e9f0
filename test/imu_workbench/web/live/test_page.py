# SPDX-License-Identifier: Apache-2.0
"""The live view of a tab that no browser has opened: what it says, offers and draws anew."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from imu_recording.logging_contract import IMU
from imu_workbench.web.live import page
from imu_workbench.web.live.listener import Watch
from imu_workbench.web.live.page import LivePage, build_live
from imu_workbench.web.live.state import LiveState, NodeStatus
from imu_workbench.web.live.topics import Topic, assign
from nicegui import Client, ui

from .heard import GRAVITY, TRUE_RATE, Clock, imu, put, stamps

RAW = Topic('/dut1/imu/data_raw', IMU, ('/dut1/imu_driver',))


class Heard:
    """What a listener has heard: topics, and the state of the one device."""

    def __init__(self, state: LiveState, *topics: Topic) -> None:
        self.state, self.topics = state, topics

    def watch(self, namespace: str, chosen: Mapping[str, str]) -> Watch:
        topics = assign(self.topics, namespace, chosen)
        return Watch(namespace, chosen, self.state, topics)


@pytest.fixture
def live(tab: Client) -> LivePage:
    return build_live(ui.element('main'))


def drawn(live: LivePage) -> dict[str, bool]:
    """Update the view; tell which of its figures were given new content."""
    plots = {'measured': live._measured, 'temperature': live._temperature}
    before = {name: plot.figure for name, plot in plots.items()}
    live._update()
    return {name: plot.figure is not before[name] for name, plot in plots.items()}


def hear_on(state: LiveState, begin_s: float) -> None:
    """Give the state three tenths of a second more."""
    put(state, 'raw', imu(stamps(0.3, 100, begin_s), TRUE_RATE, GRAVITY))
    state.absorb()


def test_without_a_device_it_says_where_none_is_heard(live, monkeypatch) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', '17')
    live._listener = Heard(LiveState())
    assert not live._update()
    assert live._message.text == page.NO_IMU_HEARD.format(domain=17)
    assert not live._body.visible


def test_the_first_device_is_taken_and_shown_once_it_is_heard(live, state) -> None:
    waiting = LiveState()
    live._listener = Heard(waiting, RAW)
    assert not live._update()
    assert live._device.value == '/dut1'
    assert live._device.options == {'/dut1': '/dut1'}
    assert live._message.text == 'Waiting for the first samples …'
    live._watch.state = state
    assert live._update()
    assert live._body.visible
    assert not live._message.visible
    assert '9.8' in live._values.content
    assert not live._update()  # nothing new was heard


def test_a_display_on_hold_draws_nothing_new(live, state) -> None:
    live._listener = Heard(state, RAW)
    live._hold.value = True
    assert not live._update()
    live._hold.value = False
    assert live._update()


def test_it_warns_where_two_nodes_publish_on_one_topic(live, state) -> None:
    mixed = Topic('/dut1/imu/data_raw', IMU, ('/dut1/imu_driver', '/bag_player'), publishers=2)
    live._listener = Heard(state, mixed)
    live._update()
    assert live._message.text.startswith('Warning: /dut1/imu/data_raw has 2 publishers')


def test_it_names_silent_topics_and_a_bag_that_started_again(live, state, clock: Clock) -> None:
    live._listener = Heard(state, RAW)
    clock.time += 10.0
    live._update()
    assert live._message.text == 'Silent: /dut1/imu/data_raw'
    put(state, 'raw', imu(stamps(1, 100, begin_s=-60.0), TRUE_RATE, GRAVITY))
    state.absorb()
    live._update()
    assert live._message.text == 'The time stamps jumped back 1×: the history was cleared.'


def test_a_long_window_is_drawn_once_a_second(live, state) -> None:
    live._listener = Heard(state, RAW)
    live._window.value = 3600.0
    assert drawn(live) == {'measured': True, 'temperature': True}
    hear_on(state, begin_s=20.0)
    assert drawn(live) == {'measured': True, 'temperature': True}
    hear_on(state, begin_s=20.3)  # within the same second
    assert drawn(live) == {'measured': False, 'temperature': False}
    live._window.value = 20.0
    assert drawn(live) == {'measured': True, 'temperature': True}
    hear_on(state, begin_s=20.6)  # a short window shows every sample
    assert drawn(live) == {'measured': True, 'temperature': False}


def test_statuses_of_other_devices_are_left_out(live, state) -> None:
    live._listener = Heard(state, RAW, Topic('/dut2/imu/data_raw', IMU, ('/dut2/imu_driver',)))
    for name, level in (('dut1/imu_driver', 1), ('dut2/imu_driver', 0)):
        state.put_status(NodeStatus(name, level, 'frames lost', received=state.now()))
    live._update()
    assert set(live._seen) == {'dut1/imu_driver'}
    assert live._seen['dut1/imu_driver'][0].text == 'warning: dut1/imu_driver: frames lost'


def test_a_middleware_that_does_not_exist_is_named_and_ends_only_a_trial(monkeypatch) -> None:
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_of_nobody')
    with pytest.raises(RuntimeError, match='rmw_of_nobody'):
        page._listener()
