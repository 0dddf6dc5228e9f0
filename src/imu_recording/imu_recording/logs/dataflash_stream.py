# SPDX-License-Identifier: Apache-2.0
"""Messages of a DataFlash log that is too long for memory: read in pieces, samples averaged.

A message is two bytes of mark, its type and its content; the message FMT says how long those of a
type are. Layout: ArduPilot, AP_Logger/LogStructure.h.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from imu_recording.jit import njit
from imu_recording.logs.block_means import BlockMeans
from imu_recording.recording import FloatArray, IntArray

PIECE_BYTES = 1 << 23
"""Size of the pieces that are read at a time."""
HEAD_BYTES = 3
"""Size of a message's head, before its content."""
DEFINITION_TYPE = 0x80
"""Type of the message that says how long others are."""
TIME_COLUMN, INSTANCE_COLUMN = 'TimeUS', 'I'


@dataclass(frozen=True)
class MessageLayout:
    """Layout of the content of one type of messages."""

    number: int
    """Number of the type."""
    content: np.dtype[Any]
    factors: Mapping[str, float | None]
    """Factors of the columns to their units."""

    def column(self, rows: Any, name: str) -> FloatArray:
        """Return a column of messages in its unit."""
        values: FloatArray = rows[name].astype(np.float64)
        factor = self.factors.get(name)
        return values if factor is None else values * factor


@dataclass
class StreamedMessages:
    """Messages that were read, one by one and averaged."""

    messages: dict[str, Any] = field(default_factory=dict)
    """By name, as they stand in the log."""
    tables: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Columns by name of the message: times in µs as integers, instances one after the other."""
    averaged: int = 1
    """Samples in each row, at most."""
    lost: int = 0
    """Bytes that are no message."""


def stream_messages(
    path: Path,
    lengths: IntArray,
    whole: Mapping[str, MessageLayout],
    averaged: Mapping[str, tuple[MessageLayout, Sequence[str]]],
    rows: int,
) -> StreamedMessages:
    """Return the messages of `whole` as they are, and columns of `averaged` with at most `rows`.

    `lengths`: (256,) bytes of the messages of each type, 0 where unknown.
    """
    found = StreamedMessages()
    layouts = {**whole, **{name: layout for name, (layout, _) in averaged.items()}}
    kind_of = np.full(256, -1, np.int64)
    for kind, layout in enumerate(layouts.values()):
        kind_of[layout.number] = kind
    counts = np.zeros(len(layouts), np.int64)
    for _, _, kinds in _pieces(path, lengths, kind_of, StreamedMessages()):
        counts += np.bincount(kinds, minlength=len(layouts))
    parts: dict[str, list[Any]] = {name: [] for name in whole}
    means: dict[str, dict[int, BlockMeans]] = {name: {} for name in averaged}
    for piece, offsets, kinds in _pieces(path, lengths, kind_of, found):
        for kind, (name, layout) in enumerate(layouts.items()):
            mine = offsets[kinds == kind]
            messages = messages_at(piece, mine, layout)
            if name in whole:
                parts[name].append(messages)
            elif len(mine):
                count = int(-(-counts[kind] // rows))
                found.averaged = max(found.averaged, count)
                _average(means[name], messages, layout, averaged[name][1], count)
    for name, kept in parts.items():
        found.messages[name] = np.concatenate([np.zeros(0, layouts[name].content), *kept])
    for name, instances in means.items():
        found.tables[name] = _table(instances, INSTANCE_COLUMN in layouts[name].factors)
    return found


def messages_at(piece: Any, offsets: IntArray, layout: MessageLayout) -> Any:
    """Return the messages whose contents stand at some bytes."""
    places = offsets[:, None] + np.arange(layout.content.itemsize)
    return piece[places].view(layout.content)[:, 0]


def _average(
    means: dict[int, BlockMeans],
    messages: Any,
    layout: MessageLayout,
    columns: Sequence[str],
    count: int,
) -> None:
    """Add messages to the means of their instance."""
    has_instance = INSTANCE_COLUMN in layout.factors
    instance = messages[INSTANCE_COLUMN] if has_instance else np.zeros(len(messages), np.int64)
    for number in np.unique(instance).tolist():
        own = messages[instance == number]
        values = {name: layout.column(own, name) for name in columns if name in layout.factors}
        means.setdefault(number, BlockMeans(count)).add(own[TIME_COLUMN].astype(np.int64), values)


def _table(instances: Mapping[int, BlockMeans], has_instance: bool) -> dict[str, Any]:
    """Return the columns of all instances, one after the other."""
    results = {number: means.result() for number, means in sorted(instances.items())}
    if not results:
        return {}
    columns: dict[str, Any] = {TIME_COLUMN: np.concatenate([time for time, _ in results.values()])}
    names = next(iter(results.values()))[1]
    for name in names:
        columns[name] = np.concatenate([values[name] for _, values in results.values()])
    if has_instance:
        lengths = [len(time) for time, _ in results.values()]
        columns[INSTANCE_COLUMN] = np.repeat(list(results), lengths)
    return columns


def _pieces(
    path: Path, lengths: IntArray, kind_of: IntArray, found: StreamedMessages
) -> Iterator[tuple[Any, IntArray, IntArray]]:
    """Yield bytes, offsets of contents in them and their kinds, piece after piece."""
    known = lengths.copy()
    offsets = np.zeros(PIECE_BYTES // HEAD_BYTES, np.int64)
    kinds = np.zeros(PIECE_BYTES // HEAD_BYTES, np.int64)
    with path.open('rb') as stream:
        rest = b''
        while True:
            read = stream.read(PIECE_BYTES - len(rest))
            piece = np.frombuffer(rest + read, np.uint8)
            at, many, lost = scan_messages(piece, known, kind_of, offsets, kinds)
            found.lost += lost
            yield piece, offsets[:many], kinds[:many]
            if not read:
                found.lost += len(piece) - at
                return
            rest = bytes(piece[at:])


@njit
def scan_messages(
    piece: Any, lengths: Any, kind_of: Any, offsets: Any, kinds: Any
) -> tuple[int, int, int]:
    """Go through messages; return where the last whole one ends, how many are listed, bytes lost.

    `lengths` takes in the definitions that are met. Bytes that are no message are passed over.
    """
    at = many = lost = 0
    n = len(piece)
    while at + HEAD_BYTES <= n:
        length = lengths[piece[at + 2]]
        if piece[at] != 0xA3 or piece[at + 1] != 0x95 or length < HEAD_BYTES:
            at += 1
            lost += 1
            continue
        if at + length > n:
            break
        if piece[at + 2] == DEFINITION_TYPE and lengths[piece[at + HEAD_BYTES]] == 0:
            lengths[piece[at + HEAD_BYTES]] = piece[at + HEAD_BYTES + 1]
        kind = kind_of[piece[at + 2]]
        if kind >= 0:
            offsets[many] = at + HEAD_BYTES
            kinds[many] = kind
            many += 1
        at += length
    return at, many, lost
