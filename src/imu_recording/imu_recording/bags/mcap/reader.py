# SPDX-License-Identifier: Apache-2.0
"""Read mcap files record by record, closed or not, and the summary of those that were closed.

A scan needs nothing but the records themselves: no footer, no index, no metadata.yaml. Format:
https://mcap.dev/spec, version 0.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from imu_recording.bags.compression import decompress_chunk
from imu_recording.bags.decoding.cdr import Bytes
from imu_recording.bags.decoding.cdr_kernels import little64
from imu_recording.bags.decoding.topic_columns import Channel, MessageBlock, empty_block
from imu_recording.bags.mcap.footer import BLOCK_BYTES, read_footer, summary_bytes
from imu_recording.bags.mcap.writer import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    CHUNK_HEAD,
    DATA_END,
    MAGIC,
    MESSAGE,
    METADATA,
    SCHEMA,
    STATISTICS,
)
from imu_recording.jit import njit
from imu_recording.recording import BagError, IntArray

RECORD_END = 0
"""The bytes given are used up."""
RECORD_OTHER = 1
"""A record that is not a message follows."""
RECORD_CUT = 2
"""A record continues behind the last byte given."""
RECORD_FULL = 3
"""The output arrays are full."""

LOOSE_MESSAGES_END = (0, CHUNK, ATTACHMENT, DATA_END)
"""Records that end a row of messages outside chunks."""
LARGEST_CHUNK_BYTES = 1 << 32
"""A chunk that claims to be larger is damage [bytes]."""
_COUNTS_OFFSET = 8 + 2 + 4 + 4 + 4 + 4 + 8 + 8
"""Bytes of a statistics record before the messages by channel."""


@dataclass
class McapScan:
    """One mcap file: `select` maps a channel to a slot or −1, `deliver` gets the messages."""

    select: Callable[[Channel], int]
    deliver: Callable[[MessageBlock], None]
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    complete: bool = False
    """Whether the file ended properly, with its footer."""
    problems: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._schemas: dict[int, tuple[str, str]] = {}
        self._slots = np.full(1 << 16, -1, np.int64)
        self._arrays = empty_block(1 << 14)

    def run(self, stream: BinaryIO, name: str) -> None:
        """Scan a file from its first byte on; raise BagError where it is no mcap file."""
        if stream.read(len(MAGIC)) != MAGIC:
            raise BagError(f'{name}: not an mcap file (its first bytes are wrong)')
        buffer = bytearray(BLOCK_BYTES)
        place = len(MAGIC)
        while True:
            head = stream.read(9)
            if len(head) < 9 or not head[0]:
                break
            opcode, size = head[0], int.from_bytes(head[1:], 'little')
            if opcode == DATA_END:
                self.complete = stream.read().endswith(MAGIC)
                break
            if size > LARGEST_CHUNK_BYTES and opcode != MESSAGE:
                break
            if opcode == MESSAGE:
                end = self._loose(stream, head, place)
            elif opcode == ATTACHMENT:
                end = self._attachment(stream, size, place)
            else:
                buffer, got = _fill(stream, buffer, size)
                self._record(opcode, memoryview(buffer)[:got], size, place)
                end = place + 9 + size if got == size else -1
            if end < 0:
                break
            place = end

    def _attachment(self, stream: BinaryIO, size: int, place: int) -> int:
        """Look at the checksum of an attachment; return the place behind it, −1 where cut."""
        checksum, left = 0, size
        tail = b''
        while left:
            block = stream.read(min(left, BLOCK_BYTES))
            if not block:
                return -1
            left -= len(block)
            joined = tail + block
            checksum, tail = zlib.crc32(joined[:-4], checksum), joined[-4:]
        wanted = int.from_bytes(tail, 'little')
        if wanted and wanted != checksum:
            self.problems.append(f'the attachment at byte {place}: its checksum is wrong')
        return place + 9 + size

    def _record(self, opcode: int, content: memoryview, size: int, place: int) -> None:
        whole = len(content) == size
        if opcode == CHUNK:
            self.chunk(content, size, place)
        elif whole:
            self.declare(opcode, bytes(content))

    def declare(self, opcode: int, content: bytes) -> None:
        """Take in a schema, channel or metadata record."""
        if opcode == SCHEMA:
            key, name, _, definition = _parse('Hsss', content)
            self._schemas[key] = (name, definition)
        elif opcode == CHANNEL:
            key, schema, topic, encoding, metadata = _parse('HHssm', content)
            message_type, definition = self._schemas.get(schema, ('', ''))
            qos = metadata.get('offered_qos_profiles', '')
            channel = Channel(
                topic=topic,
                message_type=message_type,
                encoding=encoding,
                definition=definition,
                qos=qos,
            )
            if key not in self.channels:
                self.channels[key] = channel
                self._slots[key] = self.select(channel)
        elif opcode == METADATA:
            name, values = _parse('sm', content)
            self.metadata[name] = values

    def chunk(self, content: memoryview, size: int, place: int) -> None:
        """Decompress one chunk, or what is there of it, and scan it."""
        if len(content) < CHUNK_HEAD.size:
            return
        _, _, expected, checksum, text = CHUNK_HEAD.unpack_from(content)
        at = CHUNK_HEAD.size + text
        if at + 8 > len(content):
            return
        compression = bytes(content[CHUNK_HEAD.size : at]).decode(errors='replace')
        records = content[at + 8 :]
        whole = len(content) == size
        try:
            data = decompress_chunk(records, compression, expected, partial=not whole)
        except ValueError as error:
            self.problems.append(f'the chunk at byte {place} is left out: {error}')
            return
        if whole and checksum and zlib.crc32(data) != checksum:
            self.problems.append(f'the chunk at byte {place} is left out: its checksum is wrong')
            return
        self._records(np.frombuffer(data, np.uint8))

    def _records(self, buffer: np.ndarray[tuple[int], np.dtype[np.uint8]]) -> int:
        """Scan records lying in a buffer; return the byte behind the last whole one."""
        at, end = 0, len(buffer)
        while at < end:
            offset, length, received, slot = self._arrays
            count, at, reason = find_messages(
                buffer, at, end, self._slots, offset, length, received, slot
            )
            if count:
                block = MessageBlock(
                    buffer=buffer,
                    offset=offset,
                    length=length,
                    received=received,
                    slot=slot,
                    count=count,
                )
                self.deliver(block)
            if reason == RECORD_FULL:
                self._arrays = empty_block(2 * len(offset))
            elif reason == RECORD_OTHER:
                size = int.from_bytes(buffer[at + 1 : at + 9].tobytes(), 'little')
                if size > end - at - 9 or buffer[at] in LOOSE_MESSAGES_END:
                    break
                if buffer[at] in (SCHEMA, CHANNEL):
                    self.declare(int(buffer[at]), buffer[at + 9 : at + 9 + size].tobytes())
                at += 9 + size
            elif reason != RECORD_END:
                break
        return int(at)

    def _loose(self, stream: BinaryIO, head: bytes, place: int) -> int:
        """Scan messages outside chunks; return the place of the next record, −1 at the end."""
        rest = bytearray(head)
        start = place
        while True:
            block = stream.read(BLOCK_BYTES)
            rest += block
            used = self._records(np.frombuffer(bytes(rest), np.uint8))
            place += used
            del rest[:used]
            opcode = rest[0] if rest else MESSAGE
            if opcode in (CHUNK, ATTACHMENT):
                stream.seek(place)
                return place
            if opcode == DATA_END:
                self.complete = (bytes(rest) + stream.read()).endswith(MAGIC)
                return -1
            too_long = len(rest) > 9 and int.from_bytes(rest[1:9], 'little') > LARGEST_CHUNK_BYTES
            if not block or (not opcode) or too_long:
                self.problems.append(f'loose messages from byte {start} end at byte {place}')
                return -1


def _fill(stream: BinaryIO, buffer: bytearray, size: int) -> tuple[bytearray, int]:
    """Read `size` bytes, or up to the file's end; return the buffer and how many there are.

    The buffer grows only as bytes come, whatever a damaged record claims.
    """
    got = 0
    while got < size:
        if got == len(buffer):
            buffer = buffer + bytearray(min(size - got, max(len(buffer), BLOCK_BYTES)))
        view = memoryview(buffer)[got:size]
        count = stream.readinto(view)  # type: ignore[attr-defined]
        if not count:
            break
        got += count
    return buffer, got


def _parse(fields: str, content: bytes) -> list[Any]:
    """Parse a record: H uint16, s string, m map of strings; missing bytes read as empty."""
    values: list[Any] = []
    at = 0
    for kind in fields:
        if kind == 'H':
            values.append(int.from_bytes(content[at : at + 2], 'little'))
            at += 2
            continue
        size = int.from_bytes(content[at : at + 4], 'little')
        part = content[at + 4 : at + 4 + size]
        at += 4 + size
        values.append(part.decode(errors='replace') if kind == 's' else _parse_map(part))
    return values


def _parse_map(content: bytes) -> dict[str, str]:
    values = {}
    at = 0
    while at < len(content):
        pair = []
        for _ in range(2):
            size = int.from_bytes(content[at : at + 4], 'little')
            pair.append(content[at + 4 : at + 4 + size].decode(errors='replace'))
            at += 4 + size
        values[pair[0]] = pair[1]
    return values


@njit(cache=True, nogil=True)
def find_messages(
    buffer: Bytes,
    at: int,
    end: int,
    slot_of_channel: IntArray,
    offset: IntArray,
    length: IntArray,
    received: IntArray,
    slot: IntArray,
) -> tuple[int, int, int]:
    """Find the mcap message records (opcode 5) from byte `at` on.

    Records of channels whose slot is −1 are passed over. Fills `offset` and `length` of the
    serialised message, `received` (log time [ns]) and `slot`; returns how many, the byte where it
    stopped, and why (RECORD_…).
    """
    found = 0
    while at < end:
        if end - at < 9:
            return found, at, RECORD_CUT
        if buffer[at] != 5:
            return found, at, RECORD_OTHER
        size = little64(buffer, at + 1)
        if size < 22 or size > end - at - 9:
            return found, at, RECORD_CUT
        channel = np.int64(buffer[at + 9]) | (np.int64(buffer[at + 10]) << 8)
        wanted = slot_of_channel[channel]
        if wanted >= 0:
            if found == offset.shape[0]:
                return found, at, RECORD_FULL
            offset[found] = at + 31
            length[found] = size - 22
            received[found] = little64(buffer, at + 15)
            slot[found] = wanted
            found += 1
        at += 9 + size
    return found, at, RECORD_END


def read_summary(path: Path) -> dict[str, tuple[str, int]] | None:
    """Return message type and count by topic, or None where the file has no usable summary."""
    with path.open('rb') as stream:
        footer = read_footer(stream)
        summary = footer and summary_bytes(stream, footer)
    return _parse_summary(summary) if summary else None


def _parse_summary(summary: bytes) -> dict[str, tuple[str, int]] | None:
    scan = McapScan(select=lambda _: -1, deliver=lambda _: None)
    counts: dict[int, int] | None = None
    at = 0
    while at + 9 <= len(summary):
        opcode, size = summary[at], int.from_bytes(summary[at + 1 : at + 9], 'little')
        content = summary[at + 9 : at + 9 + size]
        at += 9 + size
        if opcode in (SCHEMA, CHANNEL):
            scan.declare(opcode, content)
        elif opcode == STATISTICS and len(content) >= _COUNTS_OFFSET + 4:
            pairs = content[_COUNTS_OFFSET + 4 :]
            counts = dict(struct.iter_unpack('<HQ', pairs[: len(pairs) // 10 * 10]))
    if counts is None or not set(counts) <= set(scan.channels):
        return None
    return _by_topic(scan.channels, counts)


def _by_topic(
    channels: dict[int, Channel], counts: dict[int, int]
) -> dict[str, tuple[str, int]] | None:
    topics: dict[str, tuple[str, int]] = {}
    for key, channel in channels.items():
        kind, count = topics.get(channel.topic, (channel.message_type, 0))
        if kind != channel.message_type or not kind:
            return None
        topics[channel.topic] = (kind, count + counts.get(key, 0))
    return topics
