# SPDX-License-Identifier: Apache-2.0
"""The bytes of an mcap file, piece by piece, without touching a file; the codes of its records.

Whoever holds the file writes what the calls return, in order, and may fsync after each: everything
up to the last flush is then readable. Format: https://mcap.dev/spec, version 0, profile ros2.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from imu_recording.bags.compression import compress_chunk

MAGIC = b'\x89MCAP0\r\n'
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
MESSAGE_INDEX, CHUNK_INDEX, ATTACHMENT = 0x07, 0x08, 0x09
STATISTICS, METADATA = 0x0B, 0x0C
METADATA_INDEX, SUMMARY_OFFSET, DATA_END = 0x0D, 0x0E, 0x0F

LIBRARY = 'imu_recording'
LATEST_STAMP_NS = 2**63 - 1
_MESSAGE = struct.Struct('<BQHIQQ')
CHUNK_BYTES = 1 << 20
"""Bytes of messages after which a chunk is closed."""
MESSAGE_HEAD_BYTES = _MESSAGE.size
"""Bytes of a message record before the serialised message."""
CHUNK_HEAD = struct.Struct('<QQQII')
"""First and last time of receipt, size and checksum of the records, length of the compression."""


@dataclass
class _OpenChunk:
    """Messages not yet flushed."""

    records: bytearray = field(default_factory=bytearray)
    first: int = LATEST_STAMP_NS
    last: int = 0
    index: dict[int, list[tuple[int, int]]] = field(default_factory=dict)


@dataclass(frozen=True)
class WrittenChunk:
    """A chunk that is in the file, as its index in the summary tells."""

    first: int
    last: int
    """Times of receipt [ns]."""
    place: int
    length: int
    """Of the whole record [bytes]."""
    indexes: Mapping[int, int]
    """Channel → place of its message index."""
    indexes_length: int
    compression: str
    packed: int
    """Bytes of the compressed records."""
    size: int
    """Bytes of the records."""

    def record(self) -> bytes:
        """Return the chunk index."""
        offsets = b''.join(struct.pack('<HQ', *entry) for entry in self.indexes.items())
        head = (self.first, self.last, self.place, self.length, len(offsets))
        return _record(
            CHUNK_INDEX,
            struct.pack('<QQQQI', *head)
            + offsets
            + struct.pack('<Q', self.indexes_length)
            + _text(self.compression)
            + struct.pack('<QQ', self.packed, self.size),
        )


def message_index(channel: int, entries: Sequence[tuple[int, int]]) -> bytes:
    """Return the message index of a chunk's channel: time of receipt [ns], place in the chunk."""
    body = b''.join(struct.pack('<QQ', *entry) for entry in entries)
    return _record(MESSAGE_INDEX, struct.pack('<HI', channel, len(body)) + body)


@dataclass
class McapStream:
    """Turns channels and messages into the bytes of an mcap file."""

    compression: str = 'zstd'
    """Of chunks: 'zstd', 'lz4' or ''."""
    position: int = 0
    """Bytes returned so far."""

    def __post_init__(self) -> None:
        self._chunk = _OpenChunk()
        self._schemas: dict[tuple[str, str], tuple[int, bytes]] = {}
        self._channels: list[bytes] = []
        self._sequence: list[int] = []
        self._chunk_index: list[bytes] = []
        self._metadata_index: list[bytes] = []
        self._first, self._last = LATEST_STAMP_NS, 0

    @property
    def pending(self) -> int:
        """Bytes of records waiting for the next flush."""
        return len(self._chunk.records)

    @property
    def counts(self) -> list[int]:
        """Messages by channel, in the order the channels were added."""
        return list(self._sequence)

    @property
    def span(self) -> tuple[int, int]:
        """First and last time of receipt [ns]; (0, 0) before the first message."""
        return (self._first, self._last) if self._last or self._first < LATEST_STAMP_NS else (0, 0)

    def begin(self) -> bytes:
        """Return the start of the file."""
        return self._out(MAGIC + _record(HEADER, _text('ros2') + _text(LIBRARY)))

    def add_channel(self, topic: str, message_type: str, definition: str, qos: str = '') -> int:
        """Return the number of a new channel; its declaration goes into the open chunk."""
        key = (message_type, definition)
        if key not in self._schemas:
            number = len(self._schemas) + 1
            encoding = 'ros2msg' if definition else ''
            content = struct.pack('<H', number) + _text(message_type) + _text(encoding)
            record = _record(SCHEMA, content + _text(definition))
            self._schemas[key] = (number, record)
            self._chunk.records += record
        channel = len(self._channels) + 1
        metadata = _map({'offered_qos_profiles': qos})
        content = struct.pack('<HH', channel, self._schemas[key][0])
        record = _record(CHANNEL, content + _text(topic) + _text('cdr') + metadata)
        self._channels.append(record)
        self._sequence.append(0)
        self._chunk.records += record
        return channel

    def add_message(self, channel: int, received: int, data: bytes | memoryview) -> None:
        """Add a serialised message to the open chunk; `received` is its time of receipt [ns]."""
        chunk = self._chunk
        chunk.index.setdefault(channel, []).append((received, len(chunk.records)))
        sequence = self._sequence[channel - 1]
        chunk.records += _MESSAGE.pack(
            MESSAGE, 22 + len(data), channel, sequence & 0xFFFFFFFF, received, received
        )
        chunk.records += data
        self._sequence[channel - 1] = sequence + 1
        chunk.first = min(chunk.first, received)
        chunk.last = max(chunk.last, received)

    def flush(self) -> bytes:
        """Return the open chunk with its message indexes; b'' where nothing waits."""
        chunk, self._chunk = self._chunk, _OpenChunk()
        if not chunk.records:
            return b''
        first = chunk.first if chunk.index else 0
        self._first, self._last = min(self._first, chunk.first), max(self._last, chunk.last)
        records = bytes(chunk.records)
        packed = compress_chunk(records, self.compression)
        compression = self.compression.encode()
        head = CHUNK_HEAD.pack(
            first, chunk.last, len(records), zlib.crc32(records), len(compression)
        )
        head += compression + struct.pack('<Q', len(packed))
        start = self.position
        pieces = [_record(CHUNK, head + packed)]
        length = len(pieces[0])
        at = start + length
        indexes = {}
        for channel, entries in chunk.index.items():
            indexes[channel] = at
            pieces.append(message_index(channel, entries))
            at += len(pieces[-1])
        written = WrittenChunk(
            first=first,
            last=chunk.last,
            place=start,
            length=length,
            indexes=indexes,
            indexes_length=at - start - length,
            compression=self.compression,
            packed=len(packed),
            size=len(records),
        )
        self._chunk_index.append(written.record())
        return self._out(b''.join(pieces))

    def resume_chunk(self, chunk: WrittenChunk, counts: Mapping[int, int]) -> None:
        """Take in a chunk that is in the file already, with its messages by channel."""
        self._chunk_index.append(chunk.record())
        for channel, count in counts.items():
            self._sequence[channel - 1] += count
        if counts:
            self._first = min(self._first, chunk.first)
            self._last = max(self._last, chunk.last)

    def resume_metadata(self, place: int, length: int, content: bytes) -> None:
        """Take in a metadata record that is in the file already."""
        name = content[: 4 + int.from_bytes(content[:4], 'little')]
        index = struct.pack('<QQ', place, length) + name
        self._metadata_index.append(_record(METADATA_INDEX, index))

    def drop_declarations(self) -> None:
        """Leave channels added since the last flush out of the next chunk: the file has them."""
        self._chunk.records.clear()

    def metadata(self, name: str, values: Mapping[str, str]) -> bytes:
        """Return a metadata record."""
        record = _record(METADATA, _text(name) + _map(values))
        place = struct.pack('<QQ', self.position, len(record))
        self._metadata_index.append(_record(METADATA_INDEX, place + _text(name)))
        return self._out(record)

    def end(self) -> bytes:
        """Return the rest of the file: the open chunk, the summary, the footer."""
        flushed = self.flush()
        data_end = _record(DATA_END, struct.pack('<I', 0))
        start = self.position + len(data_end)
        groups = [
            (SCHEMA, b''.join(record for _, record in self._schemas.values())),
            (CHANNEL, b''.join(self._channels)),
            (STATISTICS, self._statistics()),
            (CHUNK_INDEX, b''.join(self._chunk_index)),
            (METADATA_INDEX, b''.join(self._metadata_index)),
        ]
        summary, offsets = b'', b''
        for opcode, content in groups:
            if content:
                place = struct.pack('<BQQ', opcode, start + len(summary), len(content))
                offsets += _record(SUMMARY_OFFSET, place)
                summary += content
        offset_start = start + len(summary)
        summary += offsets
        footer = struct.pack('<BQQQ', FOOTER, 20, start, offset_start)
        checksum = zlib.crc32(summary + footer)
        return flushed + self._out(
            data_end + summary + footer + struct.pack('<I', checksum) + MAGIC
        )

    def _statistics(self) -> bytes:
        first, last = self.span
        counts = b''.join(
            struct.pack('<HQ', number, count) for number, count in enumerate(self._sequence, 1)
        )
        return _record(
            STATISTICS,
            struct.pack(
                '<QHIIIIQQI',
                sum(self._sequence),
                len(self._schemas),
                len(self._channels),
                0,
                len(self._metadata_index),
                len(self._chunk_index),
                first,
                last,
                len(counts),
            )
            + counts,
        )

    def _out(self, data: bytes) -> bytes:
        self.position += len(data)
        return data


def _record(opcode: int, content: bytes) -> bytes:
    return struct.pack('<BQ', opcode, len(content)) + content


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack('<I', len(data)) + data


def _map(values: Mapping[str, str]) -> bytes:
    pairs = b''.join(_text(key) + _text(value) for key, value in values.items())
    return struct.pack('<I', len(pairs)) + pairs
