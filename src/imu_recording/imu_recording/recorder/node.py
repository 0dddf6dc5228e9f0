# SPDX-License-Identifier: Apache-2.0
"""Records topics, a bag for each run: raw, reliable where offered, on disk every second."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from imu_recording.bags.metadata import Qos, qos_profile
from imu_recording.free_space import free_bytes
from imu_recording.recorder.run_announcement import RUN_TOPIC, parse_notice
from imu_recording.recorder.run_recorder import RunRecorder
from imu_recording.recorder.settings import RecorderConfig, output_folder, recorder_health
from imu_recording.recording import BagError, RecordingError
from imu_recording.ros.lifecycle_node import ACTIVE, ConfiguredNode
from imu_recording.ros.run_node import run_node


class DiscoveringNode(ConfiguredNode):
    """Hands the serialised messages of every wanted topic to `take`, with what was offered."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.unknown: set[str] = set()
        """Topics of a type that is not installed."""

    def is_wanted(self, topic: str) -> bool:
        """Tell whether to subscribe."""
        raise NotImplementedError

    def take(self, topic: str, message_type: str, data: bytes, offered: list[Qos]) -> None:
        """Act on a serialised message; `offered` lists the QoS profiles of its publishers."""
        raise NotImplementedError

    def listen(self, message_class: type, topic: str, callback: Callable[[Any], None]) -> None:
        """Subscribe to a latched topic in every state: what it said before counts, too."""
        self.inputs[topic] = callback
        if not self._capture:
            subscription = self.create_subscription(message_class, topic, callback, latched_qos())
            self._entities.append(lambda: self.destroy_subscription(subscription))

    def every(self, period_s: float, act: Callable[[], None]) -> None:
        """Call `act` every so many seconds of the host, whatever the ROS time."""
        timer = self.create_timer(period_s, act, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._entities.append(lambda: self.destroy_timer(timer))

    def discover(self) -> None:
        """Subscribe to wanted topics that have appeared; latched ones speak at once."""
        if self.state != ACTIVE or self._capture:
            return
        for topic, types in self.get_topic_names_and_types():
            if topic in self.inputs or topic in self.unknown or not self.is_wanted(topic):
                continue
            offers = self.get_publishers_info_by_topic(topic)
            if offers:
                self.subscribe(topic, types[0], [offer.qos_profile for offer in offers])

    def subscribe(self, topic: str, message_type: str, offers: Sequence[Any] = ()) -> None:
        """Subscribe to the serialised messages of one topic."""
        package, _, name = message_type.split('/')
        try:
            message_class = getattr(import_module(f'{package}.msg'), name)
        except (ImportError, AttributeError):
            self.unknown.add(topic)
            self.get_logger().error(f'{topic}: type {message_type} is not installed')
            return
        qos, offered = self.matching_qos(offers)

        def on_bytes(data: bytes) -> None:
            self.take(topic, message_type, data, offered)

        self.input(message_class, topic, on_bytes, qos=qos, raw=True)

    def matching_qos(self, offers: Sequence[Any]) -> tuple[Any, list[Qos]]:
        """Return what to ask for, as strict as every publisher offers, and how to note it."""
        reliable = all(o.reliability == ReliabilityPolicy.RELIABLE for o in offers)
        latched = bool(offers) and all(
            o.durability == DurabilityPolicy.TRANSIENT_LOCAL for o in offers
        )
        qos = latched_qos() if latched else QoSProfile(depth=self.config.qos_depth)
        qos.depth = self.config.qos_depth
        if not reliable:
            qos.reliability = ReliabilityPolicy.BEST_EFFORT
        return qos, [qos_profile(reliable=reliable, latched=latched, depth=qos.depth)]


def latched_qos() -> Any:
    """Return the profile of a subscription that also gets what was said before it."""
    return QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class RecorderNode(DiscoveringNode):
    """Records topics as they appear, raw, to a bag; to one for each run a chamber announces."""

    config_class = RecorderConfig

    def __init__(self, **options):
        super().__init__('recorder', **options)

    def setup(self, config):
        """Take the folder and begin to look for topics."""
        self.recorder = RunRecorder(config, output_folder(config.output))
        self.failure = ''
        self.listen(String, RUN_TOPIC, self.on_run)
        self.every(0.5, self.discover)
        self.every(1.0, self.flush)

    def activated(self):
        """Look for topics at once."""
        self.tell()
        self.discover()

    def is_wanted(self, topic):
        """Tell whether the recording needs the topic."""
        return self.recorder.needs(topic)

    def take(self, topic, message_type, data, offered):
        """Record a message."""
        self.attempt(self.recorder.record, topic, message_type, data, self.now(), offered)

    def on_run(self, message):
        """Go on with the bag of the run that the chamber says is under way."""
        try:
            notice = parse_notice(message.data)
            self.attempt(self.recorder.follow, notice, self.now())
        except RecordingError as error:
            self.get_logger().error(str(error))
            return
        self.tell()
        self.discover()

    def tell(self):
        """Log where the recording goes."""
        folder = self.recorder.plan.folder
        self.get_logger().info(f'recording to {folder}' if folder else 'waiting for the next run')

    def attempt(self, act, *arguments):
        """Write unless writing has failed; a failure ends the recording and is reported."""
        if self.failure:
            return
        try:
            act(*arguments)
        except BagError as error:
            self.failure = str(error)
            self.get_logger().error(f'recording stopped: {error}')
            self.publish_diagnostics()

    def flush(self):
        """Put what was received on disk; wait a little for a chamber that has just appeared."""
        expecting = not self._capture and self.count_publishers(RUN_TOPIC) > 0
        self.attempt(partial(self.recorder.flush, expecting=expecting))

    def deactivated(self):
        """Close the bag."""
        self.attempt(self.recorder.close)

    def diagnostics(self):
        """Tell what is recorded, and what went wrong."""
        if not hasattr(self, 'recorder'):
            return 0, self.state, {}
        folder = self.recorder.plan.folder
        free = free_bytes(self.recorder.output)
        values = {'folder': folder or 'none', 'messages': self.recorder.messages}
        values |= {'topics': len(self.inputs), 'free_bytes': free}
        waiting = '' if folder else 'waiting for the next run'
        return *recorder_health(self.failure, self.unknown, free, waiting), values


def main():
    """Run the node."""
    return run_node(RecorderNode)
