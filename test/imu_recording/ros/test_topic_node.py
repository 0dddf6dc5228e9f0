# SPDX-License-Identifier: Apache-2.0
"""Inputs and outputs of a node, and what it says where nothing comes."""

from __future__ import annotations

from typing import Any

from doubler import Doubler, make
from imu_recording.ros.diagnostics import InputTimeout
from imu_recording.ros.losses import REMEMBERED_CALLS
from imu_recording.ros.topic_node import CapturedPublisher
from rclpy.qos import ReliabilityPolicy
from std_msgs.msg import Float64


def test_inputs_reach_outputs_in_one_process(ros: Any) -> None:
    node, sent = make(factor=3)
    assert node.autostart()
    node.inputs['in'](Float64(data=2.0))
    assert sent == [('out', Float64(data=6.0))]
    node.destroy_node()


def test_qos_overrides_are_honoured(ros: Any) -> None:
    overrides = {
        'qos_overrides./in.subscription.reliability': 'reliable',
        'qos_overrides./in.subscription.depth': 7,
        'qos_overrides./out.publisher.reliability': 'best_effort',
    }
    node = Doubler('doubler', parameters=overrides)
    assert node.autostart()
    (heard,) = node.get_subscriptions_info_by_topic('/in')
    (sent,) = node.get_publishers_info_by_topic('/out')
    assert heard.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert sent.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert node.get_parameter('qos_overrides./in.subscription.depth').value == 7
    node.destroy_node()


class Hearer(Doubler):
    expects = 'in'

    def diagnostics(self) -> tuple[int, str, dict[str, Any]]:
        return 0, 'well', {}


def test_a_node_that_hears_nothing_names_the_topic_and_what_is_close(ros: Any) -> None:
    clock = [0.0]
    node = Hearer('hearer', namespace='/here')
    node._input_timeout = InputTimeout(lambda: clock[0])
    assert node.autostart()
    other = ros.create_node('other', namespace='/here')
    publisher = other.create_publisher(Float64, 'inn', 10)
    heard: list[Any] = []
    node._diagnostics_publisher = CapturedPublisher('/diagnostics', lambda _, m: heard.append(m))
    for clock[0] in (4.0, 6.0):
        node.publish_diagnostics()
    early, late = (message.status[1] for message in heard)
    assert early.name == 'here/hearer: input'
    assert (early.level, early.message) == (b'\x00', 'receiving')
    assert late.level == b'\x01'
    assert late.message == '/here/in has no publisher; /here/inn has'
    other.destroy_publisher(publisher)
    other.destroy_node()
    node.destroy_node()


def test_losses_are_counted_and_warned_of_while_they_are_new(ros: Any) -> None:
    node, sent = make()
    node.said = (0, 'well')
    assert node.autostart()
    for stamp in [*range(0, 500, 10), 530]:
        node.losses.gaps_of('/in').add(stamp)
    node.losses.dropped['/in'] += 2
    node.publish_diagnostics()
    for _ in range(REMEMBERED_CALLS):
        node.publish_diagnostics()
    first, *_, last = [message.status[1] for topic, message in sent if topic == '/diagnostics']
    assert first.level == b'\x01'
    assert first.message.startswith('2 messages dropped, 3 samples missing in the last 10 s')
    assert last.message == 'receiving'
    assert {v.key: v.value for v in last.values}['samples_missing'] == '3'
    assert node.losses.by_topic() == {'/in': 3}
    node.destroy_node()
