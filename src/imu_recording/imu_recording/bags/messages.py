# SPDX-License-Identifier: Apache-2.0
"""The serialised messages of a bag one by one: read for replay, written byte for byte the same."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from imu_recording.bags.decoding.message_types import definition_of
from imu_recording.bags.decoding.topic_columns import Channel, MessageBlock
from imu_recording.bags.files import BagFile, locate_bag
from imu_recording.bags.mcap.writer import CHUNK_BYTES, McapStream
from imu_recording.bags.metadata import RecordedFile, qos_profile, qos_text, write_metadata
from imu_recording.bags.scan import open_ros1, scan_messages, topics_of_file
from imu_recording.recording import BagError


@dataclass(frozen=True)
class BagMessage:
    """One serialised message."""

    received: int
    """Time of receipt [ns]."""
    topic: str
    data: bytes
    """CDR with encapsulation."""


@dataclass
class _Collector:
    """Keeps a topic's messages as they are."""

    topic: str
    into: list[BagMessage]

    def define(self, channel: Channel) -> None:
        """Accept any definition: nothing is decoded here."""

    def take(self, block: MessageBlock, slot: int) -> None:
        """Keep the block's messages of this topic."""
        for i in range(block.count):
            if block.slot[i] == slot:
                message = BagMessage(int(block.received[i]), self.topic, block.bytes_of(i))
                self.into.append(message)


def bag_topics(path: str | PathLike[str]) -> dict[str, str]:
    """Return topic → message type of a bag."""
    return {
        topic: message_type
        for file in locate_bag(path).files
        for topic, (message_type, _) in topics_of_file(file).items()
    }


def read_messages(path: str | PathLike[str], topics: Collection[str]) -> list[BagMessage]:
    """Return the messages of the topics by time of receipt, equal times in the topics' order."""
    found: list[BagMessage] = []
    for file in locate_bag(path).files:
        if file.storage == 'ros1':
            found += _ros1_messages(file, topics)
            continue
        scan_messages(file, {topic: _Collector(topic, found) for topic in topics}, {}, '')
    rank = {topic: place for place, topic in enumerate(topics)}
    return sorted(found, key=lambda message: (message.received, rank[message.topic]))


def _ros1_messages(file: BagFile, topics: Collection[str]) -> list[BagMessage]:
    """Return a ROS 1 bag's messages in ROS 2's serialisation."""
    with open_ros1(file.path) as reader:
        wanted = [c for c in reader.connections if c.topic in topics]
        return [
            BagMessage(received, c.topic, bytes(reader.typestore.ros1_to_cdr(raw, c.msgtype)))
            for c, received, raw in reader.messages(wanted)
        ]


def write_messages(
    messages: Iterable[BagMessage], types: Mapping[str, str], path: str | PathLike[str]
) -> None:
    """Write messages, in the order given, to a new mcap bag; `types` maps topic to type."""
    folder = Path(path)
    if folder.exists():
        raise BagError(f'{folder}: exists already; remove it or name another')
    folder.mkdir(parents=True)
    name = f'{folder.name}_0.mcap'
    counts: Counter[str] = Counter()
    stream = McapStream()
    profile = qos_profile(reliable=True, latched=False, depth=500)
    with (folder / name).open('wb') as file:
        file.write(stream.begin())
        channels = {
            topic: stream.add_channel(topic, kind, definition_of(kind), qos_text([profile]))
            for topic, kind in types.items()
        }
        for message in messages:
            stream.add_message(channels[message.topic], message.received, message.data)
            counts[message.topic] += 1
            if stream.pending > CHUNK_BYTES:
                file.write(stream.flush())
        file.write(stream.end())
    first, last = stream.span
    written = RecordedFile(name, first=first, last=last, counts=dict(counts))
    topics = {topic: (kind, [profile]) for topic, kind in types.items()}
    write_metadata(folder, [written], topics, {}, sync=False)
