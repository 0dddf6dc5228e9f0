# SPDX-License-Identifier: Apache-2.0
"""Subscriptions to a running ROS system, in a context and a thread of their own.

Messages of the IMU stay bytes: the thread only queues them; they are decoded a few times a second,
so that 1 kHz of several topics does not hold up the page.
"""

from __future__ import annotations

import atexit
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from imu_recording.ros.message_cdr import message_class
from rclpy.context import Context
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from imu_workbench.web.live.state import LiveState, NodeStatus
from imu_workbench.web.live.topics import DIAGNOSTIC_ARRAY, ROLES, Topic, assign

ABSORB_PERIOD_S = 0.05
"""Period at which queued messages are decoded [s]."""
GRAPH_PERIOD_S = 1.0
"""Period at which the ROS graph is read [s]."""
QUEUE_DEPTH = 1000
SUBSCRIBED_TYPES = {role.message_type for role in ROLES.values()} | {DIAGNOSTIC_ARRAY}


@dataclass
class Watch:
    """One device that pages look at."""

    namespace: str
    chosen: Mapping[str, str]
    """Role → topic where the user picked it."""
    state: LiveState = field(default_factory=LiveState)
    topics: dict[str, str] = field(default_factory=dict)
    """Role → topic, as far as found."""


class Listener:
    """Subscribes to what the pages' devices publish. Pages share it, and what it heard.

    `domain_id` None: that of the environment, ROS_DOMAIN_ID.
    """

    def __init__(self, domain_id: int | None = None) -> None:
        self.topics: tuple[Topic, ...] = ()
        """Topics that were published when the graph was read last."""
        self._watches: dict[tuple[str, tuple[tuple[str, str], ...]], Watch] = {}
        self._subscriptions: dict[str, Any] = {}
        self._targets: dict[str, list[tuple[LiveState, str]]] = {}
        self._ended = threading.Event()
        self._context = Context()
        rclpy.init(args=[], context=self._context, domain_id=domain_id)
        self._node = rclpy.create_node(
            'imu_workbench_live',
            context=self._context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._node.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, QoSProfile(depth=100)
        )
        self._thread = threading.Thread(target=self._listen, name='live', daemon=True)
        self._thread.start()

    @property
    def listening(self) -> bool:
        """Whether the thread runs."""
        return self._thread.is_alive()

    def watch(self, namespace: str, chosen: Mapping[str, str] | None = None) -> Watch:
        """Return the device in `namespace` with the history heard so far."""
        key = (namespace, tuple(sorted((chosen or {}).items())))
        if key not in self._watches:
            self._watches[key] = Watch(namespace, dict(chosen or {}))
        return self._watches[key]

    def close(self) -> None:
        """Stop listening."""
        self._ended.set()
        self._thread.join(timeout=5.0)

    def _listen(self) -> None:
        executor = EventsExecutor(context=self._context)
        executor.add_node(self._node)
        absorb_at = read_graph_at = 0.0
        try:
            while not self._ended.is_set() and self._context.ok():
                executor.spin_once(timeout_sec=ABSORB_PERIOD_S / 2)
                now = time.monotonic()
                if now >= read_graph_at:
                    read_graph_at = now + GRAPH_PERIOD_S
                    self._read_graph()
                if now >= absorb_at:
                    absorb_at = now + ABSORB_PERIOD_S
                    for watch in tuple(self._watches.values()):
                        watch.state.absorb()
        finally:
            executor.remove_node(self._node)
            self._node.destroy_node()
            rclpy.try_shutdown(context=self._context)

    def _read_graph(self) -> None:
        """Read the ROS graph; subscribe to the topics that the devices have now."""
        self.topics = tuple(self._published())
        types = {topic.name: topic for topic in self.topics}
        for watch in tuple(self._watches.values()):
            for role, name in assign(self.topics, watch.namespace, watch.chosen).items():
                topic = types.get(name)
                before = watch.topics.get(role)
                wanted = ROLES[role].message_type
                if topic is None or before == name or topic.message_type != wanted:
                    continue
                if before:
                    self._targets[before].remove((watch.state, role))
                    watch.state.forget(role)
                watch.topics[role] = name
                self._targets.setdefault(name, []).append((watch.state, role))
                self._subscribe(topic)
        for name in [name for name, targets in self._targets.items() if not targets]:
            self._node.destroy_subscription(self._subscriptions.pop(name))
            del self._targets[name]

    def _published(self) -> list[Topic]:
        found = []
        for name, types in self._node.get_topic_names_and_types():
            if types[0] not in SUBSCRIBED_TYPES:
                continue
            publishers = self._node.get_publishers_info_by_topic(name)
            if publishers:
                nodes = {p.node_namespace.rstrip('/') + '/' + p.node_name for p in publishers}
                kept = DurabilityPolicy.TRANSIENT_LOCAL
                latched = all(p.qos_profile.durability == kept for p in publishers)
                own = tuple(sorted(nodes))
                found.append(
                    Topic(
                        name=name,
                        message_type=types[0],
                        nodes=own,
                        latched=latched,
                        publishers=len(publishers),
                    )
                )
        return found

    def _subscribe(self, topic: Topic) -> None:
        if topic.name in self._subscriptions:
            return
        quality = QoSProfile(depth=QUEUE_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        if topic.latched:  # only a reliable subscription is sent what was said before it
            quality.reliability = ReliabilityPolicy.RELIABLE
            quality.durability = DurabilityPolicy.TRANSIENT_LOCAL
        self._subscriptions[topic.name] = self._node.create_subscription(
            message_class(topic.message_type),
            topic.name,
            partial(self._on_bytes, self._targets[topic.name]),
            quality,
            raw=True,
        )

    @staticmethod
    def _on_bytes(targets: list[tuple[LiveState, str]], data: bytes) -> None:
        for state, role in targets:
            state.put(role, data)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for watch in tuple(self._watches.values()):
            for status in message.status:
                watch.state.put_status(
                    NodeStatus(
                        name=status.name,
                        level=status.level[0],
                        message=status.message,
                        values={item.key: item.value for item in status.values},
                        received=watch.state.now(),
                    )
                )


_shared: list[Listener] = []


def shared_listener() -> Listener:
    """Return the one listener of this process; start it where there is none."""
    if not _shared or not _shared[0].listening:
        _shared[:] = [Listener()]
    return _shared[0]


@atexit.register
def close_listener() -> None:
    """Stop the shared listener: a process that ends while its thread waits is aborted."""
    for listener in _shared:
        listener.close()
    _shared.clear()
