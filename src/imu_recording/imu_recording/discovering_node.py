# SPDX-License-Identifier: Apache-2.0
"""A node that subscribes to wanted topics, whatever their type, as they appear."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from imu_recording.lifecycle_node import ACTIVE, ConfiguredNode
from imu_recording.recorder_metadata import Qos, qos_profile


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
