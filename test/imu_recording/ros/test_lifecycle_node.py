# SPDX-License-Identifier: Apache-2.0
"""The shell of every node: parameters, states, outputs, diagnostics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest
from imu_recording.ros.diagnostics import InputTimeout
from imu_recording.ros.lifecycle_node import CapturedPublisher, ConfiguredNode
from imu_recording.ros.losses import REMEMBERED_CALLS, StampGaps
from imu_recording.ros.messages import float_message
from imu_recording.ros.parameter import NodeConfig, ParameterError, parameter
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy
from std_msgs.msg import Float64

STAMP = 1_700_000_000_500_000_000


@dataclass(frozen=True)
class DoublerConfig(NodeConfig):
    factor: float = parameter(2.0, 'Factor', bounds=(0.0, 10.0), dynamic=True)
    topic: str = parameter('out', 'Where to')
    weights: list[float] = parameter([1.0], 'Weights', bounds=(0.0, 2.0))  # noqa: RUF009


class Doubler(ConfiguredNode):
    config_class = DoublerConfig

    def setup(self, config: Any) -> None:
        if config.topic == 'taken':
            raise ValueError('topic taken: choose another')
        self.publisher = self.output(Float64, config.topic)
        self.input(Float64, 'in', self.on_number)

    def on_number(self, message: Any) -> None:
        self.publisher.publish(float_message(message.data * self.config.factor))

    def diagnostics(self) -> tuple[int, str, dict[str, Any]]:
        return 1, 'doubling', {'device': 'd', 'factor': self.config.factor}


def make(**parameters: Any) -> tuple[Doubler, list[tuple[str, Any]]]:
    sent: list[tuple[str, Any]] = []
    node = Doubler(
        'doubler',
        capture=lambda topic, message: sent.append((topic, message)),
        now=lambda: STAMP,
        parameters=parameters,
    )
    return node, sent


def test_inputs_reach_outputs_in_one_process(ros: Any) -> None:
    node, sent = make(factor=3)
    assert node.autostart()
    node.inputs['in'](Float64(data=2.0))
    assert sent == [('out', Float64(data=6.0))]
    node.destroy_node()


def test_dynamic_parameters_change_while_active_and_others_do_not(ros: Any) -> None:
    node, sent = make()
    node.autostart()
    changed = node.set_parameters([Parameter('factor', value=5)])[0]
    fixed = node.set_parameters([Parameter('topic', value='other')])[0]
    wrong = node.set_parameters([Parameter('factor', value=50.0)])[0]
    assert changed.successful
    assert not fixed.successful
    assert 'topic takes effect at configuration' in fixed.reason
    assert node.set_parameters([Parameter('topic', value='out')])[0].successful, 'as it is'
    assert not wrong.successful
    assert '50' in wrong.reason
    node.inputs['in'](Float64(data=2.0))
    assert sent[-1][1].data == 10.0
    node.destroy_node()


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


def test_a_list_of_numbers_may_be_of_integers(ros: Any) -> None:
    node, _ = make(weights=[1, 0])
    assert node.autostart()
    assert node.config.weights == [1.0, 0.0]
    node.destroy_node()
    with pytest.raises(ParameterError, match="weights is 'heavy', expected a list"):
        make(weights='heavy')
    with pytest.raises(ParameterError, match='factor is -1, expected 0 … 10'):
        make(factor=-1)


def test_a_double_stays_a_double(ros: Any) -> None:
    node, _ = make(factor=3)
    assert type(node.get_parameter('factor').value) is float
    assert node.set_parameters([Parameter('factor', value=4)])[0].successful
    assert node.get_parameter('factor').type_ == Parameter.Type.DOUBLE
    assert not node.set_parameters([Parameter('factor', value='much')])[0].successful
    assert not node.describe_parameter('factor').dynamic_typing
    assert node.set_parameters([Parameter('weights', value=[2, 1])])[0].successful
    assert node.get_parameter('weights').type_ == Parameter.Type.DOUBLE_ARRAY
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


def test_another_rate_is_no_loss() -> None:
    gaps = StampGaps()
    stamp = 0
    for step in [10] * 50 + [25] * 60 + [50] + [25] * 3 + [20_000_000_000] + [25] * 3:
        stamp += step
        gaps.add(stamp)
    assert gaps.missing == 1


def test_stamps_in_bursts_tell_no_loss() -> None:
    gaps = StampGaps()
    for burst in range(100):
        for sample in range(4):
            gaps.add(8_000_000 * burst + 100_000 * sample)
    assert gaps.missing == 0
