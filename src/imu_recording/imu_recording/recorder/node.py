# SPDX-License-Identifier: Apache-2.0
"""Records topics, a bag for each run: raw, reliable where offered, on disk every second."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from imu_recording.bags.metadata import Qos, qos_profile
from imu_recording.free_space import free_bytes
from imu_recording.logging_contract import IMU
from imu_recording.recorder.plan import (
    INTERNAL_TOPICS,
    MEGABYTE_BYTES,
    RecorderConfig,
    missing_topics,
    output_folder,
)
from imu_recording.recorder.run_announcement import RUN_TOPIC, parse_announcement
from imu_recording.recorder.run_recorder import RunRecorder
from imu_recording.recording import BagError, RecordingError
from imu_recording.ros.diagnostics import NO_HARDWARE, Status, node_of
from imu_recording.ros.lifecycle_node import ConfiguredNode
from imu_recording.ros.losses import nothing_heard
from imu_recording.ros.message_cdr import message_class
from imu_recording.ros.parameter_node import ACTIVE
from imu_recording.ros.run_node import run_node
from imu_recording.ros.sample_bytes import stamp_from_bytes
from imu_recording.ros.topic_node import DIAGNOSTICS_TOPIC, latched_qos

DISCOVERY_PERIOD_S = 0.5
FLUSH_PERIOD_S = 1.0
LOW_DISK_BYTES = 1 << 30
"""Less free space is a warning [bytes]."""


class RecorderNode(ConfiguredNode):
    """Records topics as they appear, raw, to a bag; to one for each run a chamber announces."""

    config_class = RecorderConfig
    task = 'recording'
    logs_status = True
    event_driven = True
    config: RecorderConfig

    def __init__(self, **options: Any) -> None:
        super().__init__('recorder', **options)
        self.unknown: set[str] = set()
        """Topics of a type that is not installed."""
        self._others: set[str] = set()
        """Devices that took the place of the one the bag is of."""
        self._waiting: deque[tuple[str, str, bytes, int, list[Qos]]] = deque()

    def setup(self, config: RecorderConfig) -> None:
        """Take the folder and begin to look for topics."""
        self.recorder = RunRecorder(config, output_folder(config.output))
        for file, messages in self.recorder.repaired.items():
            self.get_logger().warning(f'{file} was cut: repaired, {messages} messages')
        self.failure = ''
        self.listen(String, RUN_TOPIC, self.on_run)
        if not self._capture:
            heard = self.create_subscription(
                DiagnosticArray, DIAGNOSTICS_TOPIC, self.on_diagnostics, 10
            )
            self._entities.append(lambda: self.destroy_subscription(heard))
        self.every(DISCOVERY_PERIOD_S, self.discover)
        self.every(FLUSH_PERIOD_S, self.flush)

    def activated(self) -> None:
        """Look for topics at once."""
        self.log_folder()
        self.discover()

    def deactivated(self) -> None:
        """Close the bag."""
        self.write_waiting()
        self.recorder.note_losses(self.losses.by_topic())
        self.attempt(self.recorder.close)

    def diagnostics(self) -> Status:
        """Return what is recorded, and what went wrong."""
        if not hasattr(self, 'recorder'):
            return 0, self.state, {}
        folder = self.recorder.plan.folder
        free = free_bytes(self.recorder.output)
        values: dict[str, Any] = {
            'folder': folder or 'none',
            'messages': self.recorder.messages,
            'topics': len(self.inputs),
            'free_bytes': free,
        }
        waiting = '' if folder else 'waiting for the next run'
        return *recorder_health(self.failure, self.unknown, free, waiting), values

    def _never_heard(self) -> str:
        """Return which topics asked for by name are missing, or why nothing was recorded yet."""
        if self._capture or not self._input_timeout.is_overdue or not self.recorder.plan.folder:
            return ''
        heard = [topic for topic in sorted(self.inputs) if is_measured(topic)]
        others = [
            topic
            for topic, _ in self.get_topic_names_and_types()
            if is_measured(topic) and topic not in heard and self.count_publishers(topic)
        ]
        missing = missing_topics(self.config.topics, [*self.inputs, *self.unknown])
        reasons = [nothing_heard(topic, 0, others) for topic in missing]
        if not reasons and not heard:
            wanted = ', '.join(self.recorder.plan.topics) or 'what could be recorded'
            reasons = [nothing_heard(wanted, 0, others)]
        elif not reasons and not self.recorder.messages:
            reasons = [nothing_heard(heard[0], 1, others)]
        return '; '.join(reasons)

    # Recording --------------------------------------------------------------------------------

    def on_run(self, message: String) -> None:
        """Go on with the bag of the run that the chamber announces."""
        try:
            announcement = parse_announcement(message.data)
            self.attempt(self.recorder.follow, announcement, self.now())
        except RecordingError as error:
            self.get_logger().error(str(error))
            return
        self.log_folder()
        self.discover()

    def on_diagnostics(self, message: DiagnosticArray) -> None:
        """Name in the bag the device whose imu/data_raw is recorded, and what simulates it."""
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            source, device = values.get('transport', ''), status.hardware_id
            known = device not in ('', NO_HARDWARE)
            if not known and not source.startswith('simulated://'):
                continue
            for space in self.spaces_of(node_of(status.name)):
                if source.startswith('simulated://'):
                    self.attempt(self.recorder.note, 'simulated', source)
                if known and not self.config.device:
                    self.note_device(f'{space}/device' if space else 'device', device)

    def note_device(self, key: str, device: str) -> None:
        """Name the device in the bag; of two, the first: what follows is an error in the log."""
        before = self.recorder.noted(key)
        if not before:
            self.attempt(self.recorder.note, key, device)
        elif before != device and device not in self._others:
            self._others.add(device)
            self.get_logger().error(f'the bag is of device {before}, the data now of {device}')

    def spaces_of(self, node: str) -> list[str]:
        """Return the namespaces of the imu/data_raw topics that are recorded from a node.

        It is named without the first /.
        """
        return [
            topic.removesuffix('/imu/data_raw')
            for topic in self.inputs
            if topic.endswith('/imu/data_raw')
            for sender in self.get_publishers_info_by_topic(topic)
            if f'{sender.node_namespace}/{sender.node_name}'.lstrip('/') == node
        ]

    def flush(self) -> None:
        """Put what was received on disk; wait a little for a chamber that has just appeared."""
        expecting = not self._capture and self.count_publishers(RUN_TOPIC) > 0
        self.write_waiting()
        self.attempt(partial(self.recorder.flush, expecting=expecting))

    def attempt(self, act: Callable[..., None], *arguments: Any) -> None:
        """Write unless writing has failed; a failure ends the recording and is reported."""
        if self.failure:
            return
        try:
            act(*arguments)
        except BagError as error:
            self.failure = str(error)
            self.get_logger().error(f'recording stopped: {error}')
            self.publish_diagnostics()

    def log_folder(self) -> None:
        """Log where the recording goes."""
        folder = self.recorder.plan.folder
        self.get_logger().info(f'recording to {folder}' if folder else 'waiting for the next run')

    # Topics -----------------------------------------------------------------------------------

    def discover(self) -> None:
        """Subscribe to wanted topics that have appeared; latched ones send at once."""
        if self.state != ACTIVE or self._capture:
            return
        for topic, types in self.get_topic_names_and_types():
            known = topic in self.inputs or topic in self.unknown
            if known or not self.recorder.needs(topic):
                continue
            if self.take_within(topic, types[0]):
                continue
            offers = self.get_publishers_info_by_topic(topic)
            if offers:
                self.subscribe(topic, types[0], [offer.qos_profile for offer in offers])

    def subscribe(self, topic: str, message_type: str, offers: Sequence[Any] = ()) -> None:
        """Subscribe to the serialised messages of one topic; `offers` are its publishers' QoS."""
        try:
            kind = message_class(message_type)
        except (ImportError, AttributeError):
            self.unknown.add(topic)
            self.get_logger().error(f'{topic}: type {message_type} is not installed')
            return
        qos, offered = matching_qos(offers, self.config.qos_depth)
        on_bytes = partial(self.on_bytes, topic, message_type, offered)
        self.input(kind, topic, on_bytes, qos=qos, raw=True)

    def on_bytes(self, topic: str, message_type: str, offered: list[Qos], data: bytes) -> None:
        """Record a serialised message; of an Imu, count the samples missing before it."""
        if message_type == IMU:
            self.losses.gaps_of(topic).add(stamp_from_bytes(data))
        self.write_waiting()
        self.attempt(self.recorder.record, topic, message_type, data, self.now(), offered)

    def take_within(self, topic: str, message_type: str) -> bool:
        """Take the messages of a node of this process; return whether there is one."""
        offered = [qos_profile(reliable=True, latched=False, depth=self.config.qos_depth)]
        return self.serialised_input(topic, partial(self._queue, topic, message_type, offered))

    def _queue(self, topic: str, message_type: str, offered: list[Qos], data: bytes) -> None:
        self._waiting.append((topic, message_type, data, self.now(), offered))

    def write_waiting(self) -> None:
        """Record what nodes of this process have sent: their threads never wait for the disk."""
        while self._waiting:
            self.attempt(self.recorder.record, *self._waiting.popleft())

    def listen(self, message_type: type, topic: str, callback: Callable[[Any], None]) -> None:
        """Subscribe to a latched topic in every state: what it said before counts, too."""
        self.inputs[topic] = callback
        if not self._capture:
            subscription = self.create_subscription(message_type, topic, callback, latched_qos())
            self._entities.append(lambda: self.destroy_subscription(subscription))

    def every(self, period_s: float, act: Callable[[], None]) -> None:
        """Call `act` every so many seconds of the host, whatever the ROS time."""
        timer = self.create_timer(period_s, act, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._entities.append(lambda: self.destroy_timer(timer))


def is_measured(topic: str) -> bool:
    """Tell whether a topic can carry measurements: those about nodes and runs do not."""
    about_nodes = (RUN_TOPIC, DIAGNOSTICS_TOPIC, *INTERNAL_TOPICS)
    return topic not in about_nodes and not topic.endswith('/transition_event')


def matching_qos(offers: Sequence[Any], depth: int) -> tuple[Any, list[Qos]]:
    """Return the strictest QoS that every publisher offers, and its entry in the bag."""
    reliable = all(o.reliability == ReliabilityPolicy.RELIABLE for o in offers)
    latched = bool(offers) and all(
        o.durability == DurabilityPolicy.TRANSIENT_LOCAL for o in offers
    )
    qos = latched_qos() if latched else QoSProfile(depth=depth)
    qos.depth = depth
    if not reliable:
        qos.reliability = ReliabilityPolicy.BEST_EFFORT
    return qos, [qos_profile(reliable=reliable, latched=latched, depth=depth)]


def recorder_health(
    failure: str, unknown: Collection[str], free: int, waiting: str = ''
) -> tuple[int, str]:
    """Return the level (0 ok, 1 warn, 2 error) and line for /diagnostics."""
    if failure:
        return 2, f'recording stopped: {failure}'
    if unknown:
        return 1, f'types not installed: {", ".join(sorted(unknown))}'
    if free < LOW_DISK_BYTES:
        return 1, f'{free / MEGABYTE_BYTES:.0f} MB left on the disk'
    return 0, waiting or 'recording'


def main() -> int:
    """Run the node."""
    return run_node(RecorderNode)
