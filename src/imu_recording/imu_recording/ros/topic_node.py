# SPDX-License-Identifier: Apache-2.0
"""A node's inputs and outputs: messages of other processes, samples of this one, and losses."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from imu_recording.ros.diagnostics import InputTimeout, Status
from imu_recording.ros.exchange import CapturedOutput, Exchange, SampleOutput
from imu_recording.ros.losses import Losses, nothing_heard
from imu_recording.ros.parameter_node import ParameterNode
from imu_recording.ros.sample_bytes import form_of

DIAGNOSTICS_TOPIC = '/diagnostics'


def latched_qos() -> QoSProfile:
    """Return the QoS under which late subscribers still get the newest message."""
    return QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def overridable() -> QoSOverridingOptions:
    """Return that parameters `qos_overrides.<topic>.…` may change a profile."""
    return QoSOverridingOptions(
        (
            QoSPolicyKind.HISTORY,
            QoSPolicyKind.DEPTH,
            QoSPolicyKind.RELIABILITY,
            QoSPolicyKind.DURABILITY,
        )
    )


class TopicNode(ParameterNode):
    """Calls back with inputs while the node is active, and notices when one has stopped.

    With `capture`, outputs call `capture(topic, message)`, nothing is sent; `inputs` maps topic to
    callback for those who feed messages by hand. `now` replaces the clock. Nodes of one process
    that share an `exchange` pass samples to each other as values, in the sender's thread; `lock`
    keeps what samples, timers and parameters do apart.
    """

    captures_bytes: ClassVar[bool] = False
    """Whether `capture` gets samples serialised, for the sake of simulated campaigns."""
    expects: ClassVar[str] = ''
    """Input that must not stop: a warning when it does; where there is one, status is logged."""

    def __init__(
        self,
        name: str,
        *,
        capture: Callable[[str, Any], None] | None = None,
        now: Callable[[], int] | None = None,
        exchange: Exchange | None = None,
        **options: Any,
    ) -> None:
        self._active = False
        self._capture = capture
        self._now = now
        self._exchange = exchange or Exchange()
        self._entities: list[Callable[[], None]] = []
        self.inputs: dict[str, Callable[[Any], None]] = {}
        self.outputs: list[str] = []
        self._input_timeout = InputTimeout()
        self.losses = Losses()
        super().__init__(name, **options)

    def now(self) -> int:
        """Return ROS time [ns]."""
        if self._now:
            return self._now()
        with (clock := self.get_clock().handle):  # `Clock.now` also makes a Time
            return int(clock.get_now().nanoseconds)

    def output(self, message_type: type, topic: str, *, latched: bool = False) -> Any:
        """Create a reliable publisher that sends while the node is active."""
        qos = QoSProfile(depth=self.config.qos_depth, reliability=ReliabilityPolicy.RELIABLE)
        qos = latched_qos() if latched else qos
        publisher = self._publisher(message_type, topic, qos, managed=True)
        self.outputs.append(topic)
        if not self._capture:
            self._entities.append(lambda: self.destroy_lifecycle_publisher(publisher))
        return publisher

    def sample_output(self, message_type: type, topic: str) -> Any:
        """Create an output whose `send` takes samples of a message type that `form_of` knows."""
        publisher, form = self.output(message_type, topic), form_of(message_type)
        if self._capture:
            return CapturedOutput(
                publisher, form.to_bytes if self.captures_bytes else form.to_message
            )
        local = self._exchange.topic(self.resolve_topic_name(topic))
        local.offered += 1
        self._entities.append(local.withdraw)
        return SampleOutput(publisher, form, local, self._exchange.outbox)

    def sample_input(
        self, message_type: type, topic: str, callback: Callable[[Any], None]
    ) -> None:
        """Call back with samples while the node is active: of this process, else of messages."""
        form = form_of(message_type)
        name = self.resolve_topic_name(topic)
        if not self._capture and self._exchange.offers(name):  # where nothing gets lost
            take = self._when_active(topic, callback)
            self._entities.append(self._exchange.topic(name).listen(take, serialised=False))
        else:
            if topic == self.expects:
                callback = partial(_count_and_call, self.losses.gaps_of(name).add, callback)
            self.input(message_type, topic, lambda data: callback(form.from_bytes(data)), raw=True)
        self.inputs[topic] = lambda message: callback(form.from_message(message))

    def serialised_input(self, topic: str, callback: Callable[[bytes], None]) -> bool:
        """Call back with the messages of a topic of this process; False where it has none."""
        if not self._exchange.offers(topic):
            return False
        self.inputs[topic] = callback
        take = self._when_active(topic, callback)
        self._entities.append(self._exchange.topic(topic).listen(take, serialised=True))
        return True

    def _when_active(self, topic: str, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        timeout = self._input_timeout if topic == self.expects else None
        return partial(self._hand_on, timeout, callback)

    def _hand_on(
        self, timeout: InputTimeout | None, callback: Callable[[Any], None], received: Any
    ) -> None:
        with self.lock:
            if self._active:
                if timeout:
                    timeout.heard()
                callback(received)

    def input(
        self, message_type: type, topic: str, callback: Callable[[Any], None], **options: Any
    ) -> None:
        """Subscribe best effort; the callback runs while the node is active."""
        self.inputs[topic] = callback
        if self._capture:
            return
        qos = QoSProfile(depth=self.config.qos_depth, reliability=ReliabilityPolicy.BEST_EFFORT)

        subscription = self.create_subscription(
            message_type,
            topic,
            self._when_active(topic, callback),
            options.pop('qos', qos),
            event_callbacks=self._loss_events(topic),
            qos_overriding_options=overridable(),
            **options,
        )
        self._entities.append(lambda: self.destroy_subscription(subscription))

    def diagnostics_input(self, sent: str, callback: Callable[[DiagnosticArray], None]) -> None:
        """Call back with the diagnostics of the process if it sends the topic `sent`, else of all.

        Those of the process come before what is sent afterwards.
        """
        if self._capture or not self._exchange.offers(self.resolve_topic_name(sent)):
            self.input(DiagnosticArray, DIAGNOSTICS_TOPIC, callback)
            return
        self.inputs[DIAGNOSTICS_TOPIC] = callback
        take = self._when_active(DIAGNOSTICS_TOPIC, callback)
        topic = self._exchange.topic(self.resolve_topic_name(DIAGNOSTICS_TOPIC))
        self._entities.append(topic.listen(take, serialised=False))

    def _loss_events(self, topic: str) -> SubscriptionEventCallbacks:
        count = partial(self._count_dropped, self.resolve_topic_name(topic))
        return SubscriptionEventCallbacks(message_lost=count)

    def _count_dropped(self, name: str, event: Any) -> None:
        self.losses.dropped[name] += event.total_count_change

    def _never_heard(self) -> str:
        """Return why the input that must come has brought nothing yet; '' where it has."""
        if self._capture or not self.expects or not self._input_timeout.is_overdue:
            return ''
        topic = self.resolve_topic_name(self.expects)
        if self._exchange.offers(topic):
            return f'{topic}: no sample yet'
        topics = dict(self.get_topic_names_and_types())
        kinds = topics.get(topic, [])
        own = {topic, *map(self.resolve_topic_name, self.outputs)}
        others = [
            name
            for name, types in sorted(topics.items())
            if name not in own and types == kinds and self.count_publishers(name)
        ]
        return nothing_heard(topic, self.count_publishers(topic), others)

    def _input_status(self) -> Status:
        """Return whether what this node listens to comes, and all of it."""
        status: Status = 0, 'receiving', {'topics': len(self.inputs)}
        if self.expects:
            status = self._input_timeout.applied(self.resolve_topic_name(self.expects), status)
        if reason := self._never_heard():
            status = 1, reason, status[2]
        return self.losses.applied(status)

    def _release(self) -> None:
        for release in self._entities:
            release()
        self._entities.clear()
        self.inputs.clear()
        self.outputs.clear()

    def _in_and_out(self) -> str:
        """Return the topics of this node under their full names."""
        parts = [
            f'{word} {", ".join(map(self.resolve_topic_name, topics))}'
            for word, topics in (('listens to', self.inputs), ('publishes', self.outputs))
            if topics
        ]
        return f'active: {"; ".join(parts)}' if parts else 'active'

    def _publisher(self, message_type: type, topic: str, qos: QoSProfile, *, managed: bool) -> Any:
        if self._capture:
            return CapturedPublisher(topic, self._capture)
        create = self.create_lifecycle_publisher if managed else self.create_publisher
        return create(message_type, topic, qos, qos_overriding_options=overridable())


def _count_and_call(
    count: Callable[[int], None], callback: Callable[[Any], None], sample: Any
) -> None:
    count(sample.stamp)
    callback(sample)


class CapturedPublisher:
    """Stands in for a publisher: hands every message to a function instead of DDS."""

    def __init__(self, topic: str, capture: Callable[[str, Any], None]) -> None:
        self.topic_name = topic
        self._capture = capture

    def publish(self, message: Any) -> None:
        """Hand the message over."""
        self._capture(self.topic_name, message)
