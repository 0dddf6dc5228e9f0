# SPDX-License-Identifier: Apache-2.0
"""Replay a bag through a node's own callbacks: in this process, without executor and DDS."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from importlib import import_module
from pathlib import Path
from typing import Any

from imu_recording.bags.files import locate_bag
from imu_recording.bags.messages import BagMessage, bag_topics, read_messages
from imu_recording.recording import SECOND_NS
from imu_recording.ros.message_cdr import message_class, numbers_of, serialise, type_of
from imu_recording.ros.parameter import ROS_PARAMETERS
from imu_recording.user_error import UserError, did_you_mean
from rclpy.serialization import deserialize_message

from imu_workbench.isolated_context import quiet_context

NODES: dict[str, tuple[str, str]] = {
    'thermal_comp': ('thermal_comp.node', 'ThermalCompNode'),
    'complementary_filter': ('orientation_filters.node', 'ComplementaryFilterNode'),
    'ahrs_filter': ('orientation_filters.node', 'AhrsFilterNode'),
}
"""Nodes that can be replayed: name → module and class."""

LAST_AT_ONE_TIME = ('imu/temperature', 'imu/mag', 'imu/data_raw')
"""Among messages received at one time these come last, in this order."""


class ReplayError(UserError):
    """A bag and a node that do not go together."""


@dataclass(frozen=True)
class PublishedMessage:
    """One message a node published."""

    received: int
    """Bag time at which it was published [ns]."""
    topic: str
    message: Any

    def numbers(self) -> dict[str, float]:
        """Return its floating-point fields by name."""
        return dict(numbers_of(self.message))


def replay(
    bag: Path,
    node_name: str,
    parameters: Mapping[str, Any] | None = None,
    *,
    namespace: str = '',
    remap: Mapping[str, str] | None = None,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> list[PublishedMessage]:
    """Feed a bag's messages to a node; return what it published, diagnostics every second.

    `remap` renames the node's topics ('imu/data_raw' → '/sensor/imu'); `namespace` is the
    device's. Raises ReplayError naming the topic that is missing or why the node refuses.
    """
    sent: list[PublishedMessage] = []
    clock = [0]
    node_class = _node_class(node_name)
    _check_parameters(node_class, node_name, parameters or {})
    parameters = _of_device(bag, node_class, namespace, parameters or {})
    with quiet_context() as context:
        node = node_class(
            capture=lambda topic, message: sent.append(PublishedMessage(clock[0], topic, message)),
            now=lambda: clock[0],
            parameters=parameters,
            context=context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        try:
            if not node.autostart():
                raise ReplayError(f'{node_name} refuses: {node.refused}')
            _feed(bag, node, clock, namespace.rstrip('/'), remap or {}, progress)
        finally:
            node.destroy_node()
    return [_resolved(item, node_name, namespace.rstrip('/')) for item in sent]


def _node_class(name: str) -> Any:
    if name not in NODES:
        near = did_you_mean(name, NODES)
        raise ReplayError(f'no node {name!r} to replay{near}; there are {", ".join(NODES)}')
    module, class_name = NODES[name]
    return getattr(import_module(module), class_name)


def _of_device(
    bag: Path, node_class: Any, namespace: str, parameters: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the parameters, with the bag's device for a node that has this parameter."""
    custom = locate_bag(bag).custom
    device = custom.get(f'{namespace.rstrip("/")}/device', custom.get('device', ''))
    asks = any(item.name == 'device' for item in fields(node_class.config_class))
    return ({'device': device} if asks and device else {}) | dict(parameters)


def _check_parameters(node_class: Any, node_name: str, parameters: Mapping[str, Any]) -> None:
    """Refuse a name that the node would only warn of."""
    known = sorted(item.name for item in fields(node_class.config_class))
    for name in parameters:
        if name not in known and not name.startswith(ROS_PARAMETERS):
            near = did_you_mean(name, known) or f'; it has {", ".join(known)}'
            raise ReplayError(f'{node_name} has no parameter {name!r}{near}')


def _feed(
    bag: Path,
    node: Any,
    clock: list[int],
    namespace: str,
    remap: Mapping[str, str],
    progress: Callable[[int, int], None],
) -> None:
    """Hand every message to its callback at its time of receipt."""
    callbacks, types = _topics(bag, node, namespace, remap)
    messages = read_messages(bag, list(callbacks))
    classes = {topic: message_class(types[topic]) for topic in callbacks}
    due = 0
    for place, message in enumerate(messages):
        clock[0] = message.received
        if message.received >= due or message.received < due - 2 * SECOND_NS:
            due = message.received + SECOND_NS
            progress(place, len(messages))
            if place:
                node.publish_diagnostics()
        callbacks[message.topic](deserialize_message(message.data, classes[message.topic]))
        if node.refused:
            raise ReplayError(f'{bag}: {node.get_name()} refuses: {node.refused}')
    if hasattr(node, 'finish'):
        node.finish()
    node.publish_diagnostics()


def _topics(
    bag: Path, node: Any, namespace: str, remap: Mapping[str, str]
) -> tuple[dict[str, Callable[[Any], None]], dict[str, str]]:
    """Return callback by the bag's topic, in the order of equal times, and the bag's types."""
    types = bag_topics(bag)
    chosen: dict[str, Callable[[Any], None]] = {}
    first = [name for name in node.inputs if name not in LAST_AT_ONE_TIME]
    ordered = [*first, *(name for name in LAST_AT_ONE_TIME if name in node.inputs)]
    for name in ordered:
        wanted = remap.get(name, name)
        for topic in (f'{namespace}/{wanted}', wanted, f'/{wanted}'):
            if topic in types:
                chosen[topic] = node.inputs[name]
                break
        else:
            if name == 'imu/data_raw':
                raise ReplayError(f'{bag}: no topic {namespace}/{wanted}; it has {_listed(types)}')
    return chosen, types


def _listed(types: Mapping[str, str]) -> str:
    names = sorted(types)
    return ', '.join(names[:8]) + (' …' if len(names) > 8 else '')


def _resolved(item: PublishedMessage, node_name: str, namespace: str) -> PublishedMessage:
    """Return the message under the full name of its topic."""
    topic = item.topic.replace('~', node_name, 1)
    if not topic.startswith('/'):
        topic = f'{namespace}/{topic}'
    return PublishedMessage(item.received, topic, item.message)


def as_bag_messages(sent: list[PublishedMessage]) -> tuple[list[BagMessage], dict[str, str]]:
    """Return the messages serialised, padding zero, and topic → type."""
    types: dict[str, str] = {}
    for item in sent:
        types.setdefault(item.topic, type_of(item.message))
    return [BagMessage(s.received, s.topic, serialise(s.message)) for s in sent], types
