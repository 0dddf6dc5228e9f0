# SPDX-License-Identifier: Apache-2.0
"""Roles of the topics of a running system: by the node that publishes them, then by name.

Nodes keep their names where their topics are remapped, so a publisher's name says more than a
topic's: with the driver on `imu/uncompensated` and the compensation on `imu/data_raw`, both are
found.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from imu_recording.logging_contract import (
    IMU,
    IMU_TOPIC,
    MAGNETIC_FIELD,
    MAGNETIC_TOPIC,
    TEMPERATURE,
    TEMPERATURE_TOPIC,
    TRACK_OF_FIELD,
)

DIAGNOSTIC_ARRAY = 'diagnostic_msgs/msg/DiagnosticArray'


@dataclass(frozen=True)
class Role:
    """Purpose of a topic."""

    name: str
    topic: str
    """Its usual name, relative to the device's namespace."""
    message_type: str
    node: str
    """The node that publishes it under whatever name; '' none in particular."""
    shared: bool = False
    """Whether it may stand outside the device's namespace (one chamber, several devices)."""


def _of_chamber(name: str, field: str) -> Role:
    """Return the role of a track of the logging contract that no particular node publishes."""
    track = TRACK_OF_FIELD[field]
    return Role(name, track.topic, track.message_type, '', track.shared)


ROLES: dict[str, Role] = {
    role.name: role
    for role in (
        Role('raw', IMU_TOPIC, IMU, 'imu_driver'),
        Role('compensated', 'imu_compensated/data_raw', IMU, 'thermal_comp'),
        Role('raw_field', MAGNETIC_TOPIC, MAGNETIC_FIELD, 'imu_driver'),
        Role('compensated_field', 'imu_compensated/mag', MAGNETIC_FIELD, 'thermal_comp'),
        Role('temperature', TEMPERATURE_TOPIC, TEMPERATURE, 'imu_driver'),
        Role('complementary', 'imu/data_complementary', IMU, 'complementary_filter'),
        Role('ahrs', 'imu/data_ahrs', IMU, 'ahrs_filter'),
        _of_chamber('setpoint', 'setpoint'),
        _of_chamber('air', 'chamber_temperature'),
        _of_chamber('device', 'device_temperature'),
        _of_chamber('phase', 'phase'),
    )
}
"""Everything the live view can show, by name."""
DEVICE_ROLES = tuple(name for name, role in ROLES.items() if not role.shared)
IMU_TOPIC_NAMES = tuple(role.topic for role in ROLES.values() if role.message_type == IMU)


@dataclass(frozen=True)
class Topic:
    """A topic that is published."""

    name: str
    message_type: str
    nodes: tuple[str, ...]
    """Full names of the publishing nodes."""
    latched: bool = False
    """Whether all of them keep their last message for those who come later."""
    publishers: int = 1
    """How many there are; two nodes of one name count twice."""


def namespaces(topics: Iterable[Topic]) -> list[str]:
    """Return the namespaces of devices: '' is the root.

    A topic of a usual name says where its device is; one of another name has its node's
    namespace.

    >>> at = Topic('/dut1/imu/data_raw', IMU, ('/bag_player',))
    >>> namespaces([at, Topic('/front', IMU, ('/robot/imu_driver',))])
    ['/dut1', '/robot']
    """
    found: set[str] = set()
    for topic in topics:
        if topic.message_type != IMU:
            continue
        by_name = [_before(topic.name, usual) for usual in IMU_TOPIC_NAMES]
        known = [namespace for namespace in by_name if namespace is not None]
        nodes = [node.rpartition('/')[0] for node in topic.nodes]
        found.update(known[:1] or nodes)
    return sorted(found)


def assign(
    topics: Sequence[Topic], namespace: str, chosen: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Return role → topic for the device in `namespace`; `chosen` are the user's own picks."""
    by_name = {(topic.name, topic.message_type): topic for topic in topics}
    found: dict[str, str] = {}
    for name, role in ROLES.items():
        wanted = (chosen or {}).get(name, '')
        if wanted:
            found[name] = wanted
            continue
        own = [
            topic
            for topic in topics
            if topic.message_type == role.message_type and _is_by(topic, role, namespace)
        ]
        if len(own) == 1:
            found[name] = own[0].name
            continue
        for place in _places(namespace) if role.shared else [namespace]:
            topic = by_name.get((f'{place}/{role.topic}', role.message_type))
            if topic and (not own or topic in own) and topic.name not in found.values():
                found[name] = topic.name
                break
    return found


def shared_topics(topics: Iterable[Topic], assigned: Mapping[str, str]) -> dict[str, str]:
    """Return role → why its topic cannot be told apart: it has several publishers.

    >>> both = Topic('/imu/data', IMU, ('/ahrs_filter', '/complementary_filter'), publishers=2)
    >>> shared_topics([both], {'ahrs': '/imu/data'})
    {'ahrs': '/imu/data has 2 publishers (/ahrs_filter, /complementary_filter)'}
    """
    told = {
        topic.name: f'{topic.name} has {topic.publishers} publishers ({", ".join(topic.nodes)})'
        for topic in topics
        if topic.publishers > 1
    }
    return {role: told[name] for role, name in assigned.items() if name in told}


def choices(topics: Iterable[Topic], role: str) -> list[str]:
    """Return the topics a role can have, by type."""
    wanted = ROLES[role].message_type
    return sorted(topic.name for topic in topics if topic.message_type == wanted)


def concerns(name: str, namespace: str, others: Iterable[str]) -> bool:
    """Tell whether the node `name` (without leading /) has to do with the device in `namespace`.

    >>> [concerns(n, '/dut1', ['/dut1', '/dut2']) for n in ('dut1/imu_driver', 'dut2/ahrs', 'x')]
    [True, False, True]
    """
    home = '/' + name
    if namespace and home.startswith(f'{namespace}/'):
        return True
    return not any(other and home.startswith(f'{other}/') for other in others)


def _before(name: str, usual: str) -> str | None:
    return name.removesuffix(f'/{usual}') if name.endswith(f'/{usual}') else None


def _is_by(topic: Topic, role: Role, namespace: str) -> bool:
    return bool(role.node) and f'{namespace}/{role.node}' in topic.nodes


def _places(namespace: str) -> list[str]:
    """Return the namespace and those around it, up to the root."""
    parts = namespace.split('/')
    return ['/'.join(parts[:count]) for count in range(len(parts), 0, -1)]
