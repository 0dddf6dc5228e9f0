# SPDX-License-Identifier: Apache-2.0
"""The messages of a bag one by one, as they were received, for whoever feeds them to a node."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import cast

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.rosbag1 import ReaderError

from imu_recording.bag_error import BagError
from imu_recording.bag_files import BagFile, locate_bag
from imu_recording.bag_scan import scan_file, topics_of_file
from imu_recording.topic_columns import MessageBlock, TopicColumns


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
    """Takes a topic's messages as they are, in the place of columns."""

    topic: str
    into: list[BagMessage]

    def define(self, definition: str) -> None:
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
        collectors = {topic: _Collector(topic, found) for topic in topics}
        scan_file(file, cast('dict[str, TopicColumns]', collectors), {}, '')
    rank = {topic: place for place, topic in enumerate(topics)}
    return sorted(found, key=lambda message: (message.received, rank[message.topic]))


def _ros1_messages(file: BagFile, topics: Collection[str]) -> list[BagMessage]:
    """Return a ROS 1 bag's messages in ROS 2's serialisation."""
    try:
        with AnyReader([Path(file.path)]) as reader:
            wanted = [c for c in reader.connections if c.topic in topics]
            return [
                BagMessage(received, c.topic, bytes(reader.typestore.ros1_to_cdr(raw, c.msgtype)))
                for c, received, raw in reader.messages(wanted)
            ]
    except (AnyReaderError, ReaderError) as error:
        raise BagError(f'{file.path}: cannot be read as a ROS 1 bag ({error})') from None
