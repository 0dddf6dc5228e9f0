# SPDX-License-Identifier: Apache-2.0
"""Give an mcap file that a kill cut short its message indexes, summary and footer, in place.

Chunks that are whole stay as they are; what can be read of one that is cut is written as one more
chunk. A kill during the repair leaves a file that can be repaired again.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from imu_recording.bags.decoding.topic_columns import Channel, MessageBlock
from imu_recording.bags.mcap.reader import McapScan
from imu_recording.bags.mcap.writer import (
    CHUNK,
    CHUNK_HEAD,
    DATA_END,
    MAGIC,
    MESSAGE_HEAD_BYTES,
    MESSAGE_INDEX,
    METADATA,
    McapStream,
    WrittenChunk,
    message_index,
)
from imu_recording.recording import BagError, IntArray


@dataclass
class _Chunk:
    """A chunk of the file, whole or cut."""

    place: int
    content: bytes
    length: int
    """Bytes its record says it has."""
    indexes: dict[int, int] = field(default_factory=dict)
    """Channel → place of its message index."""
    end: int = 0
    """Place behind the chunk and its indexes."""


def repair_mcap(path: Path, *, sync: bool = True) -> int | None:
    """Repair a file; return how many messages it has, None where nothing was missing.

    A file whose channels are not numbered from 1 on was not written here and is left as it is.
    BagError where another process still writes the file, or where it cannot be written.
    """
    try:
        with path.open('r+b') as stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise BagError(f'{path}: another recorder is writing it; name another') from None
            if _is_closed(stream):
                return None
            return _repair(stream, sync=sync)
    except OSError as error:
        raise BagError(f'{path}: cannot be repaired ({error.strerror})') from None


def _is_closed(stream: BinaryIO) -> bool:
    size = stream.seek(0, os.SEEK_END)
    if size < 2 * len(MAGIC):
        return False
    stream.seek(size - len(MAGIC))
    return stream.read() == MAGIC


def _repair(stream: BinaryIO, *, sync: bool) -> int | None:
    written = _Continuation()
    at = written.take(stream)
    if list(written.scan.channels) != list(range(1, len(written.scan.channels) + 1)):
        return None
    data = written.stream.begin() if not at else b''
    data += written.rest + written.stream.end()
    stream.seek(at)
    stream.write(data)
    stream.truncate()
    stream.flush()
    if sync:
        os.fsync(stream.fileno())
    return sum(written.stream.counts)


class _Continuation:
    """A stream that holds what is whole in a file and continues it where it is cut."""

    def __init__(self) -> None:
        self.stream = McapStream()
        self.rest = b''
        """Message indexes that the last whole chunk lacks."""
        self.scan = McapScan(self._select, self._deliver)
        self._blocks: list[tuple[IntArray, IntArray, IntArray, list[bytes]]] = []
        self._keep_bytes = False

    def take(self, stream: BinaryIO) -> int:
        """Read the file; return where it goes on; 0 where its start is not whole."""
        at = 0
        for opcode, place, content, length in _records(stream):
            end = place + 9 + length
            if opcode == METADATA:
                self.stream.resume_metadata(place, 9 + length, content)
            if opcode != CHUNK:
                at = end
                continue
            chunk = _Chunk(place, content, length, end=end)
            _find_indexes(stream, chunk)
            at = self._chunk(chunk)
        self.stream.position = at + len(self.rest)
        return at

    def _chunk(self, chunk: _Chunk) -> int:
        """Take in a chunk; return the place where the file goes on behind it."""
        whole = len(chunk.content) == chunk.length
        self._blocks, self._keep_bytes = [], not whole
        self.scan.chunk(memoryview(chunk.content), chunk.length, chunk.place)
        for channel in list(self.scan.channels.values())[len(self.stream.counts) :]:
            self.stream.add_channel(
                channel.topic, channel.message_type, channel.definition, channel.qos
            )
        if not whole:
            for key, received, _, data in self._blocks:
                for number, time, message in zip(key, received, data, strict=True):
                    self.stream.add_message(int(number), int(time), message)
            return chunk.place
        self.stream.drop_declarations()
        entries = self._entries()
        missing = entries.keys() - chunk.indexes.keys()
        end = chunk.end
        if missing:  # the cut lies in the indexes: all of them anew
            end, chunk.indexes = chunk.place + 9 + chunk.length, {}
            for number, times in entries.items():
                chunk.indexes[number] = end + len(self.rest)
                self.rest += message_index(number, times)
        first, last, size, _, text = CHUNK_HEAD.unpack_from(chunk.content)
        compression = chunk.content[CHUNK_HEAD.size : CHUNK_HEAD.size + text].decode()
        self.stream.resume_chunk(
            WrittenChunk(
                first=first,
                last=last,
                place=chunk.place,
                length=9 + chunk.length,
                indexes=chunk.indexes,
                indexes_length=end + len(self.rest) - chunk.place - 9 - chunk.length,
                compression=compression,
                packed=chunk.length - CHUNK_HEAD.size - text - 8,
                size=size,
            ),
            {number: len(times) for number, times in entries.items()},
        )
        return end

    def _entries(self) -> dict[int, list[tuple[int, int]]]:
        """Return time of receipt and place in the chunk of every message, by channel."""
        entries: dict[int, list[tuple[int, int]]] = {}
        for key, received, offset, _ in self._blocks:
            for channel in np.unique(key).tolist():
                mine = key == channel
                pairs = zip(received[mine].tolist(), offset[mine].tolist(), strict=True)
                entries.setdefault(channel, []).extend(pairs)
        return entries

    def _select(self, _: Channel) -> int:
        return len(self.scan.channels)  # the number of a channel in files written here

    def _deliver(self, block: MessageBlock) -> None:
        some = slice(block.count)
        data = [block.bytes_of(i) for i in range(block.count)] if self._keep_bytes else []
        place = block.offset[some] - MESSAGE_HEAD_BYTES
        self._blocks.append((block.slot[some].copy(), block.received[some].copy(), place, data))


def _records(stream: BinaryIO) -> Iterator[tuple[int, int, bytes, int]]:
    """Yield opcode, place, content and length of the records; a chunk also where it is cut."""
    size = stream.seek(0, os.SEEK_END)
    stream.seek(0)
    if stream.read(len(MAGIC)) != MAGIC:
        return
    place = len(MAGIC)
    while place + 9 <= size:
        stream.seek(place)
        head = stream.read(9)
        opcode, length = head[0], int.from_bytes(head[1:], 'little')
        whole = place + 9 + length <= size
        if opcode in (0, DATA_END) or not (whole or opcode == CHUNK):
            return
        wanted = opcode in (CHUNK, METADATA)
        if opcode != MESSAGE_INDEX:  # they are found with their chunk
            yield opcode, place, stream.read(length) if wanted else b'', length
        place += 9 + length


def _find_indexes(stream: BinaryIO, chunk: _Chunk) -> None:
    """Note the whole message indexes that follow a chunk."""
    size = stream.seek(0, os.SEEK_END)
    while chunk.end + 11 <= size:
        stream.seek(chunk.end)
        head = stream.read(11)
        length = int.from_bytes(head[1:9], 'little')
        if head[0] != MESSAGE_INDEX or chunk.end + 9 + length > size:
            return
        chunk.indexes[int.from_bytes(head[9:11], 'little')] = chunk.end
        chunk.end += 9 + length
