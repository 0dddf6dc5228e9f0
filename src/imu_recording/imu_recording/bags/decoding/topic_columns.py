# SPDX-License-Identifier: Apache-2.0
"""The growing columns of one topic, filled chunk by chunk."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imu_recording.bags.compression import ZSTD_MAGIC, decompress_message
from imu_recording.bags.decoding.cdr import LAYOUTS, LITTLE_ENDIAN, Bytes
from imu_recording.bags.decoding.cdr_kernels import decode_messages
from imu_recording.bags.decoding.message_types import DecodeError, standard_types, types_of
from imu_recording.bags.decoding.slow_decode import (
    Values,
    decode_message,
)
from imu_recording.logging_contract import STRING, Track
from imu_recording.recording import FloatArray, IntArray

_NO_WORDS = np.empty((0, 0), np.int64)
RECORDED_SINCE_NS = 946_684_800_000_000_000
"""The year 2000 [ns]: earlier times of receipt were made up."""
LEAST_CLOCK_SAMPLES = 20
"""Least number of samples from which the unit of their stamps is inferred."""


@dataclass(frozen=True)
class Channel:
    """A topic as a file of a bag declares it."""

    topic: str
    message_type: str
    encoding: str
    definition: str
    qos: str = ''
    """Offered QoS profiles as YAML."""


@dataclass
class MessageBlock:
    """Serialised messages lying in one buffer."""

    buffer: Bytes
    offset: IntArray
    length: IntArray
    received: IntArray
    """Time of receipt [ns]."""
    slot: IntArray
    """Which topic each belongs to."""
    count: int

    def bytes_of(self, index: int) -> bytes:
        """Return one serialised message."""
        at = int(self.offset[index])
        return self.buffer[at : at + int(self.length[index])].tobytes()


def block_of(messages: Sequence[bytes], received: IntArray, slot: IntArray) -> MessageBlock:
    """Return a block of separate messages, with their times of receipt [ns] and slots."""
    length = np.fromiter(map(len, messages), np.int64, len(messages))
    offset = np.zeros(len(messages), np.int64)
    np.cumsum(length[:-1], out=offset[1:])
    return MessageBlock(
        buffer=np.frombuffer(b''.join(messages), np.uint8),
        offset=offset,
        length=length,
        received=received,
        slot=slot,
        count=len(messages),
    )


@dataclass
class TopicColumns:
    """Stamps and numbers of one topic, in the order they were read."""

    track: Track
    topic: str
    """Name in the bag."""
    expected: int = 1024
    count: int = 0
    frames: Counter[str] = field(default_factory=Counter)
    texts: list[str] = field(default_factory=list)
    slow: int = 0
    """Messages decoded one at a time."""
    undecodable: int = 0
    unreported: int = 0

    def __post_init__(self) -> None:
        layout = LAYOUTS.get(self.track.message_type)
        self._layout = layout
        groups = layout.columns if layout else ()
        capacity = max(self.expected, 16)
        self._stamp = np.empty(capacity, np.int64)
        self._received = np.empty(capacity, np.int64)
        self._words = [np.empty((capacity, group.count), np.int64) for group in groups]
        self._types = standard_types()
        self._frame: Bytes | None = None
        if layout:
            shape = [int(layout.stamped), layout.doubles]
            for group in groups:
                shape += [group.first, group.unreported]
            self._shape = tuple(shape + [0, -1] * (2 - len(groups)))

    def define(self, channel: Channel) -> None:
        """Take the definition the bag carries; a type that is not standard is decoded slowly."""
        self._types = types_of(self.track.message_type, channel.definition)

    @property
    def unstamped(self) -> bool:
        """Whether the header's stamps were never set, so that times of receipt stand in."""
        return self.count > 0 and not self._stamp[: self.count].any()

    @property
    def clock_ratio(self) -> float:
        """Median interval of the times of receipt over that of the header's stamps.

        1 where one of them tells nothing: times of receipt before RECORDED_SINCE_NS were made up
        by whatever wrote the bag.
        """
        count = min(self.count, 100_000)
        if count < LEAST_CLOCK_SAMPLES or self._received[0] < RECORDED_SINCE_NS:
            return 1.0
        received, stamped = (
            float(np.median(np.diff(times[:count]))) for times in (self._received, self._stamp)
        )
        return received / stamped if received > 0.0 and stamped > 0.0 else 1.0

    def hand_over(self) -> tuple[IntArray, list[FloatArray]]:
        """Return stamps (n,) of the headers, else times of receipt [ns], and (n, k) numbers.

        Nothing is kept, so that whoever reorders them holds the only copy.
        """
        stamp = (self._received if self.unstamped else self._stamp)[: self.count]
        words, self._words = self._words, []
        self._stamp = self._received = np.empty(0, np.int64)
        return stamp, [group[: self.count].view(np.float64) for group in words]

    def take(self, block: MessageBlock, slot: int) -> None:
        """Append the block's messages of one slot."""
        mine = int(np.count_nonzero(block.slot[: block.count] == slot))
        if not mine:
            return
        self._reserve(mine)
        first, standard = 0, self._types is standard_types()
        while first < block.count:
            if standard and self._layout and self._expect_frame(block, first, slot):
                first = self._take_known(block, first, slot)
            else:
                behind = np.flatnonzero(block.slot[first : block.count] == slot)
                first = first + int(behind[0]) if behind.size else block.count
            if first < block.count:
                self._take_slowly(block.bytes_of(first), int(block.received[first]))
                first += 1

    def append(self, stamp: int | None, values: Values, text: str, received: int) -> None:
        """Append one decoded message; `text` is its frame_id, or the text of a String."""
        self._reserve(1)
        self._stamp[self.count] = received if stamp is None else stamp
        self._received[self.count] = received
        for words, numbers in zip(self._words, values, strict=True):
            words[self.count] = np.array(numbers, np.float64).view(np.int64)
        if self.track.message_type == STRING:
            self.texts.append(text)
        elif stamp is not None:
            self.frames[text] += 1
        self.count += 1

    def _take_known(self, block: MessageBlock, first: int, slot: int) -> int:
        assert self._frame is not None  # noqa: S101 (set by _expect_frame)
        second = self._words[1] if len(self._words) > 1 else _NO_WORDS
        row, stopped, unreported = decode_messages(
            block.buffer,
            (block.offset, block.length, block.received, block.slot),
            (first, block.count),
            slot,
            self._frame,
            self._shape,
            (self._stamp, self._received, self._words[0], second),
            self.count,
        )
        if self._layout and self._layout.stamped and row > self.count:
            self.frames[self._frame.tobytes().decode(errors='replace')] += row - self.count
        self.count = row
        self.unreported += unreported
        return int(stopped)

    def _take_slowly(self, raw: bytes, received: int) -> None:
        if raw.startswith(ZSTD_MAGIC):  # compressed one by one, where no metadata said so
            raw = decompress_message(raw)
        try:
            stamp, values, text = decode_message(raw, self.track.message_type, self._types)
        except DecodeError:
            self.undecodable += 1
            return
        self.slow += self.track.message_type != STRING
        self.append(stamp, values, text, received)
        if stamp is not None and raw[:2] == LITTLE_ENDIAN:
            self._frame = np.frombuffer(text.encode(), np.uint8)

    def _expect_frame(self, block: MessageBlock, first: int, slot: int) -> bool:
        """Learn the frame_id to expect from the first message; False where there is none."""
        if self._frame is None:
            where = np.flatnonzero(block.slot[first : block.count] == slot)
            if not where.size:
                return False
            raw = block.bytes_of(first + int(where[0]))
            length = int.from_bytes(raw[12:16], 'little') if self._shape[0] else 1
            if not 1 <= length <= len(raw) - 16 and self._shape[0]:
                return False
            self._frame = np.frombuffer(raw[16 : 15 + length], np.uint8)
        return True

    def _reserve(self, more: int) -> None:
        capacity = len(self._stamp)
        if self.count + more <= capacity:
            return
        capacity = max(self.count + more, capacity + capacity // 2)
        self._stamp.resize(capacity, refcheck=False)
        self._received.resize(capacity, refcheck=False)
        for words in self._words:
            words.resize((capacity, words.shape[1]), refcheck=False)


def empty_block(capacity: int) -> tuple[NDArray[np.int64], ...]:
    """Return arrays for offset, length, time of receipt and slot of that many messages."""
    return tuple(np.empty(capacity, np.int64) for _ in range(4))
