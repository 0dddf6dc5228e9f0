# SPDX-License-Identifier: Apache-2.0
"""The shell of every node: states, refusals, diagnostics and their log."""

from __future__ import annotations

from typing import Any

from doubler import STAMP, Doubler, make
from imu_recording.ros.lifecycle_node import ConfiguredNode
from rclpy.parameter import Parameter


def test_a_refused_configuration_is_no_traceback(ros: Any) -> None:
    node, _ = make(topic='taken')
    assert not node.autostart()
    assert node.state == 'unconfigured'
    assert node.inputs == {}
    node.destroy_node()


class Broken(ConfiguredNode):
    def setup(self, config: Any) -> None:
        raise IndexError('nobody has thought of this')


def test_an_error_nobody_has_thought_of_is_logged(ros: Any, capfd: Any) -> None:
    node = Broken('broken')
    assert not node.autostart()
    assert 'IndexError: nobody has thought of this' in capfd.readouterr().err
    node.destroy_node()


class Talker(Doubler):
    logs_status = True
    said: tuple[int, str] = (0, 'well')

    def diagnostics(self) -> tuple[int, str, dict[str, Any]]:
        return *self.said, {}


def test_changes_of_health_are_logged_once_at_their_level(ros: Any, capfd: Any) -> None:
    node = Talker('talker')
    assert node.autostart()
    for said in ((0, 'well'), (1, '3 lost'), (1, '4 lost'), (2, 'broken'), (0, 'well')):
        node.said = said
        node.publish_diagnostics()
    node.destroy_node()
    lines = [line for line in capfd.readouterr().err.splitlines() if '[talker]' in line]
    told = [(line.split()[0], line.partition('[talker]: ')[2]) for line in lines]
    assert told[1:] == [('[INFO]', 'well'), ('[WARN]', '3 lost'), ('[ERROR]', 'broken')]
    assert told[0] == ('[INFO]', 'active: listens to /in; publishes /out')


class Twofold(Talker):
    def tasks(self) -> dict[str, tuple[int, str, dict[str, Any]]]:
        return super().tasks() | {'second': self.second}

    second: tuple[int, str, dict[str, Any]] = (0, 'well, too', {})


def test_an_error_of_one_task_hides_no_warning_of_another(ros: Any, capfd: Any) -> None:
    node = Twofold('twofold')
    assert node.autostart()
    node.publish_diagnostics()
    node.said, node.second = (2, 'another device'), (1, '/typo has no publisher', {})
    node.publish_diagnostics()
    node.second = (0, 'well, too', {})
    node.publish_diagnostics()
    node.destroy_node()
    lines = [line for line in capfd.readouterr().err.splitlines() if '[twofold]' in line]
    told = [(line.split()[0], line.partition('[twofold]: ')[2]) for line in lines[1:]]
    assert told == [
        ('[INFO]', 'well'),
        ('[ERROR]', 'another device'),
        ('[WARN]', '/typo has no publisher'),
        ('[INFO]', 'well, too'),
    ]


def test_a_refused_node_says_why_in_diagnostics(ros: Any) -> None:
    node, sent = make(topic='taken')
    assert not node.autostart()
    node.publish_diagnostics()
    (status,) = sent[-1][1].status
    assert (status.level, status.name) == (b'\x02', 'doubler: node')
    assert status.message == 'topic taken: choose another'
    assert status.hardware_id == 'none'
    assert node.set_parameters([Parameter('topic', value='free')])[0].successful
    assert node.autostart()
    node.publish_diagnostics()
    assert sent[-1][1].status[0].message == 'doubling'
    node.destroy_node()


def test_states_and_cleanup(ros: Any) -> None:
    node, _ = make()
    assert node.state == 'unconfigured'
    node.autostart()
    assert node.state == 'active'
    node.trigger_deactivate()
    node.trigger_cleanup()
    assert (node.state, node.inputs) == ('unconfigured', {})
    assert node.autostart()
    node.destroy_node()


def test_diagnostics_carry_stamp_level_and_values(ros: Any) -> None:
    node, sent = make()
    node.autostart()
    node.publish_diagnostics()
    topic, message = sent[-1]
    status = message.status[0]
    assert topic == '/diagnostics'
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(STAMP, 10**9)
    assert (status.level, status.message, status.hardware_id) == (b'\x01', 'doubling', 'd')
    assert {v.key: v.value for v in status.values}['factor'] == '2'
    node.destroy_node()
