# SPDX-License-Identifier: Apache-2.0
"""metadata.yaml of a bag that is written here (rosbag2, version 9), and what each file holds."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from imu_recording.bags.decoding.message_types import hash_of
from imu_recording.recording import BagError

if TYPE_CHECKING:
    from imu_recording.bags.decoding.topic_columns import Channel, MessageBlock

YAML_ERRORS = (
    yaml.YAMLError, LookupError, TypeError, AttributeError, ValueError, RecursionError,
)  # fmt: skip
"""Errors of reading YAML that is damaged, or of another form than rosbag2 writes."""


@dataclass(frozen=True)
class RecordedFile:
    """One file of the bag."""

    name: str
    first: int = 0
    """Time of receipt of the first message [ns]."""
    last: int = 0
    counts: dict[str, int] = field(default_factory=dict)
    """Messages by topic."""


def inspect_file(path: Path) -> tuple[RecordedFile, dict[str, tuple[str, list[Qos]]]]:
    """Return what an mcap file holds, closed or not, and type and offered QoS by topic."""
    from imu_recording.bags.mcap.reader import McapScan  # only here: it brings compiled kernels

    found = _Inventory()
    try:
        with path.open('rb') as stream:
            McapScan(found.select, found.deliver).run(stream, str(path))
    except BagError:
        return RecordedFile(path.name), {}  # died before its first bytes were written
    counts = dict(zip(found.topics, found.counts, strict=True))
    first, last = min(found.times, default=0), max(found.times, default=0)
    return RecordedFile(path.name, first=first, last=last, counts=counts), found.topics


@dataclass
class _Inventory:
    """Topics of a scanned file, number and times of their messages."""

    topics: dict[str, tuple[str, list[Qos]]] = field(default_factory=dict)
    counts: list[int] = field(default_factory=list)
    times: list[int] = field(default_factory=list)
    """First and last time of receipt of every block [ns]."""

    def select(self, channel: Channel) -> int:
        if channel.topic not in self.topics:
            self.topics[channel.topic] = channel.message_type, qos_from_text(channel.qos)
            self.counts.append(0)
        return list(self.topics).index(channel.topic)

    def deliver(self, block: MessageBlock) -> None:
        for slot, more in enumerate(np.bincount(block.slot[: block.count]).tolist()):
            self.counts[slot] += more
        received = block.received[: block.count]
        self.times += (int(received.min()), int(received.max()))


Qos = dict[str, Any]
"""One offered QoS profile as rosbag2 writes it: history, depth, reliability, durability …"""
INFINITE_DURATION = {'sec': 9223372036, 'nsec': 854775807}
"""rmw's infinite duration."""


def qos_profile(*, reliable: bool, latched: bool, depth: int) -> Qos:
    """Return an offered QoS profile under rosbag2's keys."""
    return {
        'history': 'keep_last',
        'depth': depth,
        'reliability': 'reliable' if reliable else 'best_effort',
        'durability': 'transient_local' if latched else 'volatile',
        'deadline': dict(INFINITE_DURATION),
        'lifespan': dict(INFINITE_DURATION),
        'liveliness': 'automatic',
        'liveliness_lease_duration': dict(INFINITE_DURATION),
        'avoid_ros_namespace_conventions': False,
    }


QOS_NAMES = {
    'history': ('system_default', 'keep_last', 'keep_all', 'unknown'),
    'reliability': ('system_default', 'reliable', 'best_effort', 'unknown'),
    'durability': ('system_default', 'transient_local', 'volatile', 'unknown'),
    'liveliness': ('system_default', 'automatic', 'unknown', 'manual_by_topic'),
}
"""Names of the policies that bags before ROS 2 Jazzy number."""


def qos_from_text(text: str) -> list[Qos]:
    """Return the profiles a channel carries, in the words of Jazzy."""
    profiles = yaml.safe_load(text) or []
    return [
        {
            key: QOS_NAMES[key][value] if key in QOS_NAMES and isinstance(value, int) else value
            for key, value in dict(profile).items()
        }
        for profile in profiles
    ]


def qos_text(profiles: Sequence[Qos]) -> str:
    """Return the profiles as the YAML text a channel carries."""
    return yaml.safe_dump(list(profiles), sort_keys=False) if profiles else ''


def known_metadata(folder: Path) -> dict[str, str]:
    """Return the custom_data of a bag's metadata.yaml, nothing where it cannot be read."""
    try:
        content = yaml.safe_load((folder / 'metadata.yaml').read_text(encoding='utf-8'))
        custom = content['rosbag2_bagfile_information']['custom_data'] or {}
        return {str(key): str(value) for key, value in custom.items()}
    except (OSError, *YAML_ERRORS):
        return {}


def write_metadata(
    folder: Path,
    files: Sequence[RecordedFile],
    topics: Mapping[str, tuple[str, Sequence[Qos]]],
    custom: Mapping[str, str],
    *,
    sync: bool,
) -> None:
    """Replace metadata.yaml in one step: it is the old one or the new one, never half."""
    content = {'rosbag2_bagfile_information': _information(files, topics, custom)}
    target = folder / 'metadata.yaml'
    partial = folder / '.metadata.yaml.partial'
    with partial.open('w', encoding='utf-8') as stream:
        yaml.safe_dump(content, stream, sort_keys=False)
        if sync:
            stream.flush()
            os.fsync(stream.fileno())
    partial.replace(target)
    if sync:
        descriptor = os.open(folder, os.O_RDONLY)
        os.fsync(descriptor)
        os.close(descriptor)


def _information(
    files: Sequence[RecordedFile],
    topics: Mapping[str, tuple[str, Sequence[Qos]]],
    custom: Mapping[str, str],
) -> dict[str, Any]:
    timed = [file for file in files if file.last]
    first = min((file.first for file in timed), default=0)
    last = max((file.last for file in timed), default=0)
    return {
        'version': 9,
        'storage_identifier': 'mcap',
        'duration': {'nanoseconds': last - first},
        'starting_time': {'nanoseconds_since_epoch': first},
        'message_count': sum(sum(file.counts.values()) for file in files),
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': topic,
                    'type': message_type,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': list(profiles),
                    'type_description_hash': hash_of(message_type),
                },
                'message_count': sum(file.counts.get(topic, 0) for file in files),
            }
            for topic, (message_type, profiles) in topics.items()
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file.name for file in files],
        'files': [
            {
                'path': file.name,
                'starting_time': {'nanoseconds_since_epoch': file.first},
                'duration': {'nanoseconds': file.last - file.first},
                'message_count': sum(file.counts.values()),
            }
            for file in files
        ],
        'custom_data': dict(custom) or None,
        'ros_distro': 'jazzy',
    }
