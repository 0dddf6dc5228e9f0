# SPDX-License-Identifier: Apache-2.0
"""A bag copied message for message, with the compensated measurements beside what was measured.

Every topic keeps its name, type, frames, offered QoS and bytes. `imu_compensated/data_raw`,
`imu_compensated/mag` and the text `imu_compensated/applied_model` are added, as
thermal_comp_node publishes them.
"""

from __future__ import annotations

import contextlib
import struct
from collections import Counter
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from imu_recording.bags.decoding.cdr import ENCAPSULATION, LAYOUTS, LITTLE_ENDIAN
from imu_recording.bags.decoding.message_types import definition_of
from imu_recording.bags.files import Bag, locate_bag
from imu_recording.bags.mcap.writer import CHUNK_BYTES, McapStream
from imu_recording.bags.metadata import (
    YAML_ERRORS,
    Qos,
    RecordedFile,
    qos_from_text,
    qos_profile,
    qos_text,
    write_metadata,
)
from imu_recording.bags.reader import chosen_topics
from imu_recording.bags.scan import open_ros1, scan_messages, topics_of_file
from imu_recording.logging_contract import (
    APPLIED_MODEL,
    COMPENSATED,
    IMU_TOPIC,
    MAGNETIC_TOPIC,
    METADATA_KEYS,
    STRING,
    TRACK_OF_TOPIC,
)
from imu_recording.recording import SECOND_NS, BagError, FloatArray, ImuRecording

if TYPE_CHECKING:
    from imu_recording.bags.decoding.topic_columns import Channel, MessageBlock


def write_compensated_copy(
    recording: ImuRecording,
    source: str | PathLike[str],
    target: str | PathLike[str],
    remap: Mapping[str, str] | None = None,
) -> None:
    """Copy the bag a compensated recording was read from and add what was compensated.

    `remap` is what it was read with. Compensated topics of the source are left out. Raises
    BagError.
    """
    bag, folder = locate_bag(source), Path(target)
    if folder.exists():
        raise BagError(f'{folder}: exists already; remove it or name another')
    space, chosen = chosen_topics(bag, recording.namespace, remap)
    folder.mkdir(parents=True)
    name = f'{folder.name}_0.mcap'
    with (folder / name).open('wb') as file:
        copy = _Copy(file, f'{space}/{COMPENSATED}')
        for topic, measured in (
            (IMU_TOPIC, (recording.angular_velocity, recording.linear_acceleration)),
            (MAGNETIC_TOPIC, (recording.magnetic_field,)),
        ):
            if topic in chosen:
                copy.compensate(topic, chosen[topic], recording, measured)
        inside = _copy_messages(bag, copy)
        copy.add_text(APPLIED_MODEL, recording.compensated, int(recording.stamp[0]))
        file.write(copy.stream.end())
    custom = inside | bag.custom | {f'{space}/compensated'.strip('/'): recording.compensated}
    first, last = copy.stream.span
    counts = {topic: copy.counts[topic] for topic in copy.profiles}
    written = RecordedFile(name, first=first, last=last, counts=counts)
    write_metadata(folder, [written], copy.profiles, custom, sync=False)


def _copy_messages(bag: Bag, copy: _Copy) -> dict[str, str]:
    """Copy every message; return what the files themselves say about the recording."""
    inside: dict[str, str] = {}
    for file in bag.files:
        if file.storage == 'ros1':
            with open_ros1(file.path) as reader:
                for c in reader.connections:
                    copy.declare(c.topic, c.msgtype, '', [])
                for c, received, raw in reader.messages():
                    data = bytes(reader.typestore.ros1_to_cdr(raw, c.msgtype))
                    copy.take(c.topic, received, data)
            continue
        sinks = {topic: _TopicCopy(topic, copy) for topic in topics_of_file(file)}
        scan_messages(file, sinks, inside, '')
    return {key: value for key, value in inside.items() if key in METADATA_KEYS}


@dataclass(frozen=True)
class _Compensated:
    """Replaces the numbers in the messages of one topic by the rows of a compensated recording."""

    topic: str
    recording: ImuRecording
    columns: tuple[FloatArray, ...]
    contract_topic: str

    def message(self, data: bytes, received: int) -> bytes | None:
        """Return the message with the compensated numbers; None where it has no row."""
        layout = LAYOUTS[TRACK_OF_TOPIC[self.contract_topic].message_type]
        if data[:2] != LITTLE_ENDIAN or len(data) < 16:
            return None
        seconds, nanoseconds, length = struct.unpack_from('<iII', data, 4)
        stamp = seconds * SECOND_NS + nanoseconds or received
        stamps = self.recording.stamp
        row = int(np.searchsorted(stamps, stamp))
        body = layout.body(length - 1)
        if row == len(stamps) or len(data) < body + 8 * layout.doubles:
            return None
        if stamps[row] != stamp and self.contract_topic == IMU_TOPIC:
            return None
        changed = bytearray(data)
        for group, values in zip(layout.columns, self.columns, strict=True):
            if np.isfinite(values[row]).all():  # what was not measured stays as it is
                struct.pack_into('<3d', changed, body + 8 * group.first, *values[row])
        return bytes(changed)


@dataclass
class _Copy:
    """The bag that is written."""

    file: BinaryIO
    place: str
    """Folder of the compensated topics."""
    stream: McapStream = field(default_factory=McapStream)
    counts: Counter[str] = field(default_factory=Counter)
    profiles: dict[str, tuple[str, list[Qos]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._channels: dict[str, int] = {}
        self._compensated: dict[str, _Compensated] = {}
        self.file.write(self.stream.begin())

    def compensate(
        self,
        contract_topic: str,
        topic: str,
        recording: ImuRecording,
        columns: tuple[FloatArray, ...],
    ) -> None:
        """Let the messages of a topic be written a second time, with compensated numbers."""
        name = f'{self.place}/{contract_topic.rpartition("/")[2]}'
        self._compensated[topic] = _Compensated(
            topic=name, recording=recording, columns=columns, contract_topic=contract_topic
        )

    def declare(self, topic: str, message_type: str, definition: str, qos: list[Qos]) -> None:
        """Open the channel of a topic, and of its compensated one."""
        own = self._compensated.get(topic)
        for name in (topic, own.topic if own else topic):
            if name in self._channels or (name == topic and self._is_old(topic)):
                continue
            default = [qos_profile(reliable=True, latched=False, depth=500)]
            self._open(name, message_type, definition, deepcopy(qos) or default)

    def take(self, topic: str, received: int, data: bytes) -> None:
        """Write a message of a topic that was declared, and its compensated one."""
        if not self._is_old(topic):
            self._write(topic, received, data)
        own = self._compensated.get(topic)
        if own and (changed := own.message(data, received)) is not None:
            self._write(own.topic, received, changed)

    def add_text(self, name: str, text: str, received: int) -> None:
        """Write one latched String beside the compensated topics."""
        topic, data = f'{self.place}/{name}', text.encode() + b'\0'
        self._open(topic, STRING, '', [qos_profile(reliable=True, latched=True, depth=1)])
        self._write(topic, received, ENCAPSULATION + struct.pack('<I', len(data)) + data)

    def _is_old(self, topic: str) -> bool:
        """Tell whether a topic of the source stands where the compensated ones go."""
        return topic.startswith(f'{self.place}/')

    def _open(self, topic: str, message_type: str, definition: str, qos: list[Qos]) -> None:
        text = definition or definition_of(message_type)
        self._channels[topic] = self.stream.add_channel(topic, message_type, text, qos_text(qos))
        self.profiles[topic] = (message_type, qos)

    def _write(self, topic: str, received: int, data: bytes) -> None:
        # A damaged time of receipt may be negative, which mcap cannot hold.
        self.stream.add_message(self._channels[topic], max(received, 0), data)
        self.counts[topic] += 1
        if self.stream.pending > CHUNK_BYTES:
            self.file.write(self.stream.flush())


@dataclass
class _TopicCopy:
    """Hands the messages of one topic of a file to the copy."""

    topic: str
    copy: _Copy

    def define(self, channel: Channel) -> None:
        """Declare the topic as the bag does."""
        profiles: list[Qos] = []
        with contextlib.suppress(*YAML_ERRORS):
            profiles = qos_from_text(channel.qos)
        self.copy.declare(self.topic, channel.message_type, channel.definition, profiles)

    def take(self, block: MessageBlock, slot: int) -> None:
        """Copy the block's messages of this topic."""
        for i in np.flatnonzero(block.slot[: block.count] == slot).tolist():
            self.copy.take(self.topic, int(block.received[i]), block.bytes_of(i))
