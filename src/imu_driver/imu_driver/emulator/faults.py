# SPDX-License-Identifier: Apache-2.0
"""Faults of a line and of a board on a schedule, and the line that carries the damaged bytes.

>>> parse_fault('unplug@20+0.5')
Fault(name='unplug', start=20.0, end=20.5)
"""

from __future__ import annotations

import random
import re
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

from imu_recording.user_error import UserError

from imu_driver.emulator.board import Sent

DEFAULT_DURATION_S: Final = 2.0
"""[s] of a fault without one of its own."""

BYTE_FAULTS: Final = ('bit_flips', 'drop_bytes', 'duplicate_bytes', 'garbage')
"""Damage single bytes on the line."""
FAULTS: Final = {
    'bit_flips': 'one byte in a thousand has a bit flipped',
    'drop_bytes': 'one byte in a thousand is missing',
    'duplicate_bytes': 'one byte in a thousand comes twice',
    'garbage': 'bursts of up to 200 random bytes between and inside frames',
    'silence': 'the line carries nothing; the board keeps measuring',
    'trickle': 'the line carries 1 … 3 bytes at a time, 2000 a second',
    'unplug': 'the line is unplugged; the board keeps measuring',
    'reset': 'the board is off and restarts at the end',
    'tick_wrap': 'the tick counter passes 2³² at the start',
    'wrong_rate': 'the sensor runs at 0.7 times its nominal rate',
    'wrong_scale': 'the accelerometer is set to another full scale by itself, and back',
    'other_serial': 'another board is on the line; the first returns at the end',
}
DAMAGE_PROBABILITY: Final = 1e-3
"""Per byte."""
BURST_PROBABILITY: Final = 0.02
"""Per frame."""
LONGEST_BURST_BYTES: Final = 200
"""[bytes]."""


class FaultError(UserError):
    """A fault that cannot be scheduled; the message names it."""


class Fault(NamedTuple):
    """One fault, in seconds since the emulator's start."""

    name: str
    start: float
    end: float


def parse_fault(text: str) -> Fault:
    """Return the fault of a text NAME@SECONDS[+DURATION]; raise FaultError if it is none."""
    match = re.fullmatch(r'(\w+)@(\d+(?:\.\d*)?)(?:\+(\d+(?:\.\d*)?))?', text)
    if not match or match[1] not in FAULTS:
        raise FaultError(
            f'fault {text!r}: expected NAME@SECONDS[+DURATION] with one of {", ".join(FAULTS)}'
        )
    start = float(match[2])
    duration = float(match[3]) if match[3] else DEFAULT_DURATION_S
    return Fault(match[1], start, start + duration)


class FaultSchedule:
    """Which faults are on at a time."""

    def __init__(self, faults: Sequence[Fault] = ()) -> None:
        self.faults = tuple(sorted(faults, key=lambda fault: fault.start))

    def active(self, time: float) -> frozenset[str]:
        """Return the names of the faults that are on at `time` [s]."""
        return frozenset(f.name for f in self.faults if f.start <= time < f.end)

    def first_tick(self) -> int:
        """Return the tick at power-on that makes the counter pass 2³² at a tick_wrap fault."""
        start = next((fault.start for fault in self.faults if fault.name == 'tick_wrap'), None)
        return 0 if start is None else -round(start * 1e6) & 0xFFFFFFFF


def damage(data: bytes, fault: str, random_source: random.Random) -> bytes:
    """Return the bytes after one of BYTE_FAULTS."""
    out = bytearray()
    if fault == 'garbage':
        if random_source.random() >= BURST_PROBABILITY:
            return data
        at = random_source.randrange(len(data) + 1)
        burst = random_source.randbytes(random_source.randint(1, LONGEST_BURST_BYTES))
        return data[:at] + burst + data[at:]
    for byte in data:
        hit = random_source.random() < DAMAGE_PROBABILITY
        if not hit:
            out.append(byte)
        elif fault == 'bit_flips':
            out.append(byte ^ 1 << random_source.randrange(8))
        elif fault == 'duplicate_bytes':
            out += bytes([byte, byte])
    return bytes(out)


BUFFER_BYTES: Final = 16384
"""[bytes] Output buffer of the board: a frame that finds no room in it is dropped."""
TRICKLE_BYTES_PER_S: Final = 2000.0
"""[bytes/s] of the trickle fault."""


class FaultyLine:
    """The board's output buffer and the line behind it: damages frames and records which."""

    def __init__(self, protocol: str, seed: int = 0) -> None:
        self.sent = 0
        """Samples the board has made."""
        self.dropped = 0
        """Samples of which no byte was carried."""
        self.damaged: list[int] = []
        """Samples that arrived damaged; numbered from 0 over the whole run."""
        self._delimiter = b'\0' if protocol == 'binary' else b'\n'
        self._random = random.Random(seed)  # noqa: S311 (simulated faults)
        self._buffer: deque[bytes] = deque()
        self._size = 0
        self._unfinished = b''
        self._trickled_at: float | None = None

    def put(self, frames: Iterable[Sent], faults: frozenset[str]) -> int:
        """Take the board's frames; return how many samples found no room."""
        overruns = 0
        for frame in frames:
            number = self.sent
            is_sample = frame.sample >= 0
            self.sent += is_sample
            if faults & {'silence', 'unplug'} or self._size + len(frame.data) > BUFFER_BYTES:
                self.dropped += is_sample
                overruns += is_sample and not faults & {'silence', 'unplug'}
                continue
            data = frame.data
            for name in BYTE_FAULTS:
                if name in faults:
                    data = damage(data, name, self._random)
            if not self._arrives(frame.data, data) and is_sample:
                self.damaged.append(number)
            if data:
                self._buffer.append(data)
                self._size += len(data)
        return overruns

    def _arrives(self, original: bytes, carried: bytes) -> bool:
        """Return whether a frame arrives whole, between two delimiters."""
        *pieces, rest = (self._unfinished + carried).split(self._delimiter)
        self._unfinished = rest
        body = original[: -len(self._delimiter)]
        if self._delimiter == b'\0':
            return body in pieces
        # A line is read from its last dollar on.
        return any(piece.endswith(body) for piece in pieces)

    def take(self, time: float, faults: frozenset[str]) -> bytes:
        """Return the bytes that the line carries now."""
        if 'trickle' not in faults:
            self._trickled_at = None
            data = b''.join(self._buffer)
            self._buffer.clear()
            self._size = 0
            return data
        if self._trickled_at is None:
            self._trickled_at = time
        share = min(int((time - self._trickled_at) * TRICKLE_BYTES_PER_S), self._size)
        if share <= 0:
            return b''
        piece = self._random.randint(1, 3)
        self._trickled_at += min(share, piece) / TRICKLE_BYTES_PER_S
        waiting = b''.join(self._buffer)
        self._buffer = deque([waiting[piece:]] if waiting[piece:] else [])
        self._size = len(waiting[piece:])
        return waiting[:piece]

    def cut(self) -> None:
        """Cut the line: the buffer is lost."""
        self._buffer.clear()
        self._size = 0
        self._unfinished = b''

    def log(self, faults: Iterable[Fault], time: float) -> dict[str, Any]:
        """Return the counts a receiver's counts can be compared with."""
        return {
            'sent': self.sent,
            'dropped': self.dropped,
            'damaged': self.damaged,
            'faults': [fault._asdict() for fault in faults if fault.start <= time],
        }
