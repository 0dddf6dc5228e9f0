# SPDX-License-Identifier: Apache-2.0
"""One storage file: which topics it has, and its messages into columns."""

from __future__ import annotations

import io
import shutil
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.rosbag1 import ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError

from imu_recording.bags.compression import ZstdFile, decompress_message
from imu_recording.bags.decoding.slow_decode import values_of
from imu_recording.bags.decoding.topic_columns import (
    Channel,
    MessageBlock,
    TopicColumns,
    block_of,
)
from imu_recording.bags.files import BagFile, yaml_content
from imu_recording.bags.mcap.footer import checksum_faults
from imu_recording.bags.mcap.reader import McapScan, read_summary
from imu_recording.bags.metadata import YAML_ERRORS
from imu_recording.bags.sqlite import scan_sqlite, sqlite_channels, sqlite_metadata
from imu_recording.logging_contract import METADATA_KEYS
from imu_recording.recording import BagError

ROS1_ERRORS = (
    AnyReaderError,
    ReaderError,
    TypesysError,
    SerdeError,
    struct.error,
    AssertionError,
    LookupError,
    ValueError,
    OverflowError,
    MemoryError,
    RuntimeError,
    TypeError,
    AttributeError,
    EOFError,
)
"""Errors that rosbags raises on damaged ROS 1 bags."""
Deliver = Callable[[MessageBlock], None]
UNCLOSED_NOTE = 'was not closed: read as far as it goes'


class MessageSink(Protocol):
    """Takes the messages of one topic."""

    def define(self, channel: Channel) -> None:
        """Take what the bag says about the topic: the definition of its message type, QoS."""

    def take(self, block: MessageBlock, slot: int) -> None:
        """Take those messages of a block that belong to a slot."""


def topics_of_file(file: BagFile) -> dict[str, tuple[str, int]]:
    """Return the file's topics: message type, number of messages (0 where only a scan tells)."""
    if file.storage == 'ros1':
        with open_ros1(file.path) as reader:
            return {c.topic: (c.msgtype, c.msgcount) for c in reader.connections}
    if file.storage == 'sqlite3':
        with _plain(file) as path:
            channels: Mapping[int, Channel] = sqlite_channels(path)
            return {c.topic: (c.message_type, 0) for c in channels.values()}
    if not file.file_compressed:
        summary = read_summary(file.path)
        if summary is not None:
            return summary
    scan = McapScan(select=lambda _: -1, deliver=lambda _: None)
    _run(scan, file)
    return {c.topic: (c.message_type, 0) for c in scan.channels.values()}


def scan_columns(
    file: BagFile, columns: Mapping[str, TopicColumns], metadata: dict[str, str], space: str
) -> list[str]:
    """Append a file's messages to the columns; return notes.

    Fills what `metadata` lacks from the metadata inside the file.
    """
    if file.storage == 'ros1':
        return _scan_ros1(file.path, columns)
    return scan_messages(file, columns, metadata, space)


def scan_messages(
    file: BagFile, sinks: Mapping[str, MessageSink], metadata: dict[str, str], space: str
) -> list[str]:
    """Hand the messages of a ROS 2 file to the sink of their topic; return notes."""
    select, deliver = partial(_slot_of, file.path, sinks), partial(_distribute, sinks)
    if file.storage == 'sqlite3':
        with _plain(file) as path:
            slots = {key: select(channel) for key, channel in sqlite_channels(path).items()}
            wanted = {key: slot for key, slot in slots.items() if slot >= 0}
            problems = scan_sqlite(path, wanted, deliver, compressed=file.message_compressed)
            _metadata_inside(sqlite_metadata(path), {}, metadata, space)
        return [f'{file.path.name}: {problem}' for problem in problems]
    if file.message_compressed:
        scan = McapScan(select, partial(_decompress_and_deliver, deliver))
    else:
        scan = McapScan(select, deliver)
    _run(scan, file)
    text = scan.metadata.get('rosbag2', {}).get('serialized_metadata', '')
    _metadata_inside(text, scan.metadata.get('custom_data', {}), metadata, space)
    if not scan.complete:
        scan.problems.append(UNCLOSED_NOTE)
    return [f'{file.path.name}: {problem}' for problem in scan.problems]


def _metadata_inside(
    text: str, custom: Mapping[str, str], metadata: dict[str, str], space: str
) -> None:
    """Take device, run … from the file's own metadata where metadata.yaml lacks them."""
    found: dict[str, str] = dict(custom)
    try:
        content = yaml_content(text) if text else None
    except YAML_ERRORS:
        content = None  # the recording itself does not depend on it
    if isinstance(content, dict) and isinstance(content.get('custom_data'), dict):
        found |= {str(key): str(value) for key, value in content['custom_data'].items()}
    for key in METADATA_KEYS:
        value = found.get(f'{space}/{key}', found.get(key, ''))
        if value:
            metadata.setdefault(key, value)


def _slot_of(path: Path, sinks: Mapping[str, MessageSink], channel: Channel) -> int:
    """Return the number of the topic's sink, which takes its definition; −1: it has none."""
    if channel.topic not in sinks:
        return -1
    if channel.encoding not in ('cdr', ''):
        raise BagError(
            f'{path}: {channel.topic} is serialised as {channel.encoding!r}, expected cdr (ROS 2)'
        )
    sinks[channel.topic].define(channel)
    return list(sinks).index(channel.topic)


def _distribute(sinks: Mapping[str, MessageSink], block: MessageBlock) -> None:
    for slot, sink in enumerate(sinks.values()):
        sink.take(block, slot)


def _decompress_and_deliver(deliver: Deliver, block: MessageBlock) -> None:
    """Deliver a block whose messages are compressed one by one."""
    plain = [decompress_message(block.bytes_of(i)) for i in range(block.count)]
    deliver(block_of(plain, block.received, block.slot))


def _run(scan: McapScan, file: BagFile) -> None:
    if not file.file_compressed:
        with file.path.open('rb') as stream:
            scan.run(stream, str(file.path))
            if scan.complete:
                scan.problems += checksum_faults(stream)
        return
    with ZstdFile(file.path) as packed:
        scan.run(io.BufferedReader(packed, 1 << 20), str(file.path))
        if packed.damage:
            scan.problems.append(f'decompression stopped early: {packed.damage}')


@contextmanager
def _plain(file: BagFile) -> Iterator[Path]:
    """Give the path of a sqlite3 file, decompressed where it is compressed."""
    if not file.file_compressed:
        yield file.path
        return
    with TemporaryDirectory() as folder:
        path = Path(folder) / file.path.name.removesuffix('.zstd')
        with ZstdFile(file.path) as packed, path.open('wb') as plain:
            shutil.copyfileobj(packed, plain)
        yield path


@contextmanager
def open_ros1(path: Path) -> Iterator[AnyReader]:
    """Open a ROS 1 bag; BagError where it is damaged, also while it is read."""
    try:
        with AnyReader([path]) as reader:
            yield reader
    except BagError:
        raise
    except ROS1_ERRORS as error:
        reason = ' '.join(str(error).split())[:200] or type(error).__name__
        raise BagError(f'{path}: cannot be read as a ROS 1 bag ({reason})') from None


def _scan_ros1(path: Path, columns: Mapping[str, TopicColumns]) -> list[str]:
    with open_ros1(path) as reader:
        wanted = [c for c in reader.connections if c.topic in columns]
        for connection, received, raw in reader.messages(wanted):
            message = reader.deserialize(raw, connection.msgtype)
            stamp, values, text = values_of(message, connection.msgtype)
            columns[connection.topic].append(stamp, values, text, received)
    return []
