# SPDX-License-Identifier: Apache-2.0
"""Topics of a ULog that is too long for memory: read in pieces, samples averaged.

Layout of messages: PX4 documentation, ULog file format (header of size and type; A: subscription,
D: data, O: dropout, S: synchronisation).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from imu_recording.jit import njit
from imu_recording.logs.block_means import BlockMeans
from imu_recording.recording import IntArray

PIECE_BYTES = 1 << 23
"""Size of the pieces that are read at a time."""
FIRST_MESSAGE_OFFSET = 16
"""Place of the first message, after magic, version and time."""
SYNC_MAGIC = bytes.fromhex('2f731320250cbb12')
"""Eight bytes that stand at the end of every synchronisation message."""
TYPES = {
    'uint8_t': 'u1', 'int8_t': 'i1', 'uint16_t': '<u2', 'int16_t': '<i2', 'uint32_t': '<u4',
    'int32_t': '<i4', 'uint64_t': '<u8', 'int64_t': '<i8', 'float': '<f4', 'double': '<f8',
    'bool': 'u1', 'char': 'u1',
}  # fmt: skip
DATA, SUBSCRIPTION, DROPOUT = ord('D'), ord('A'), ord('O')
KNOWN_KINDS = np.zeros(256, np.bool_)
KNOWN_KINDS[[ord(kind) for kind in 'BFIMPQALRDCSO']] = True
"""(256,) whether a message of this kind exists."""

Topic = tuple[str, int]


@dataclass
class StreamedTopics:
    """Topics that were read, averaged, and damage that was met."""

    columns: dict[Topic, dict[str, Any]] = field(default_factory=dict)
    """Per topic and instance: columns by name; times in µs as integers."""
    averaged: int = 1
    """Samples in each row, at most."""
    dropouts: int = 0
    dropout_ms: int = 0
    damaged: int = 0
    """Places where bytes were no message."""
    cut: bool = False
    """Whether the log ends within a message."""


def stream_topics(
    path: Path, formats: Mapping[str, Any], wanted: Mapping[str, tuple[str, ...]], rows: int
) -> StreamedTopics:
    """Return columns of the wanted topics; of one with more than `rows`, means.

    Instances of a topic count together.

    `formats`: pyulog's message formats; `wanted`: names of columns by topic.
    """
    found = StreamedTopics()
    counts = dict.fromkeys(wanted, 0)
    for (name, _), _, offsets in _pieces(path, set(wanted), StreamedTopics()):
        counts[name] += len(offsets)
    means: dict[Topic, BlockMeans] = {}
    for topic, piece, offsets in _pieces(path, set(wanted), found):
        layout = _layout(formats[topic[0]])
        names = [
            n
            for n in ('timestamp', 'timestamp_sample', *wanted[topic[0]])
            if n in (layout.names or ())
        ]
        count = -(-counts[topic[0]] // rows)
        found.averaged = max(found.averaged, count)
        whole = offsets[offsets + layout.itemsize <= len(piece)]
        values = piece[whole[:, None] + np.arange(layout.itemsize)].view(layout)[:, 0]
        time = values['timestamp'].astype(np.int64)
        columns = {n: values[n].astype(np.float64) for n in names if n != 'timestamp'}
        if 'timestamp_sample' in columns:  # a float does not hold it
            since = values['timestamp_sample'].astype(np.int64) - time
            columns['timestamp_sample'] = since.astype(np.float64)
        means.setdefault(topic, BlockMeans(count)).add(time, columns)
    for topic, one in means.items():
        time, columns = one.result()
        table: dict[str, Any] = {**columns, 'timestamp': time}
        if 'timestamp_sample' in columns:
            table['timestamp_sample'] = time + np.rint(columns['timestamp_sample']).astype(int)
        found.columns[topic] = table
    return found


def ends_within_a_message(path: Path) -> bool:
    """Tell whether a log was cut off: by a lost supply, or an incomplete copy."""
    found = StreamedTopics()
    for _ in _pieces(path, set(), found):
        pass
    return found.cut


def _layout(message: Any) -> np.dtype[Any]:
    """Return numpy's type of a message; padding at its end is not in the log."""
    items = [
        (name, TYPES[kind], (size,) if size > 1 else ()) for kind, size, name in message.fields
    ]
    while items and items[-1][0].startswith('_padding'):
        items.pop()
    return np.dtype(items)


def _pieces(
    path: Path, wanted: set[str], found: StreamedTopics
) -> Iterator[tuple[Topic, Any, IntArray]]:
    """Yield topic, bytes, and offsets of its data in them, piece after piece."""
    kind_of = np.full(1 << 16, -1, np.int64)
    topics: list[Topic] = []
    offsets, kinds = np.zeros(PIECE_BYTES // 4, np.int64), np.zeros(PIECE_BYTES // 4, np.int64)
    with path.open('rb') as stream:
        stream.seek(FIRST_MESSAGE_OFFSET)
        rest = b''
        while True:
            read = stream.read(PIECE_BYTES)
            piece = np.frombuffer(rest + read, np.uint8)
            at = 0
            while True:
                at, many, stopped = scan_messages(piece, at, kind_of, KNOWN_KINDS, offsets, kinds)
                for kind in np.unique(kinds[:many]).tolist():
                    yield topics[kind], piece, offsets[:many][kinds[:many] == kind]
                if stopped == SUBSCRIPTION:
                    size, _, instance, number = struct.unpack_from('<HBBH', piece, at)
                    name = bytes(piece[at + 6 : at + 3 + size]).decode('ascii', 'replace')
                    if name in wanted:
                        kind_of[number] = len(topics)
                        topics.append((name, instance))
                    at += 3 + size
                elif stopped == DROPOUT:
                    found.dropouts += 1
                    found.dropout_ms += int(piece[at + 3]) + 256 * int(piece[at + 4])
                    at += 5
                elif stopped == 0:  # no message: go on behind the next mark
                    found.damaged += 1
                    mark = bytes(piece[at + 1 :]).find(SYNC_MAGIC)
                    at = len(piece) if mark < 0 else at + 1 + mark + len(SYNC_MAGIC)
                else:
                    break
            if not read:
                found.cut = at < len(piece)
                return
            rest = bytes(piece[at:])


@njit
def scan_messages(
    piece: Any, at: int, kind_of: Any, known: Any, offsets: Any, kinds: Any
) -> tuple[int, int, int]:
    """Go through messages; return where, how many data messages are listed, and why it stopped.

    Reasons: −1 at the end of what is complete, or A or O to be looked at, 0 what is no message.
    """
    many = 0
    n = len(piece)
    while at + 3 <= n:
        size = int(piece[at]) + 256 * int(piece[at + 1])
        kind = piece[at + 2]
        if size == 0 or not known[kind]:
            return at, many, 0
        if at + 3 + size > n:
            return at, many, -1
        if kind in (65, 79):
            return at, many, int(kind)
        if kind == 68:
            number = kind_of[int(piece[at + 3]) + 256 * int(piece[at + 4])]
            if number >= 0:
                if many == len(offsets):
                    return at, many, -1
                offsets[many] = at + 5
                kinds[many] = number
                many += 1
        at += 3 + size
    return at, many, -1
