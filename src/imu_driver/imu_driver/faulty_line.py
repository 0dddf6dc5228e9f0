# SPDX-License-Identifier: Apache-2.0
"""A line that carries a board's frames, damages them when told, and knows which it damaged."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterable
from typing import Any, Final

from imu_driver.emulated_board import Sent
from imu_driver.faults import BYTE_FAULTS, Fault, damage

BUFFER: Final = 16384
"""[bytes] Output buffer of the board: a frame that finds no room in it is dropped."""
TRICKLE_RATE: Final = 2000.0
"""[bytes/s] of the trickle fault."""


class FaultyLine:
    """The board's output buffer and the line behind it."""

    def __init__(self, protocol: str, seed: int = 0) -> None:
        self.sent = 0
        """Samples the board has made."""
        self.dropped = 0
        """Samples of which no byte was carried."""
        self.damaged: list[int] = []
        """Samples that were carried, but not as they were; numbered from 0 over the whole run."""
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
            if faults & {'silence', 'unplug'} or self._size + len(frame.data) > BUFFER:
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
        """Whether a frame can be read from the line: whole, between two delimiters."""
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
        share = min(int((time - self._trickled_at) * TRICKLE_RATE), self._size)
        if share <= 0:
            return b''
        piece = self._random.randint(1, 3)
        self._trickled_at += min(share, piece) / TRICKLE_RATE
        waiting = b''.join(self._buffer)
        self._buffer = deque([waiting[piece:]] if waiting[piece:] else [])
        self._size = len(waiting[piece:])
        return waiting[:piece]

    def cut(self) -> None:
        """The line is cut: what waits in the buffer is gone."""
        self._buffer.clear()
        self._size = 0
        self._unfinished = b''

    def log(self, faults: Iterable[Fault], time: float) -> dict[str, Any]:
        """Return what there is to compare a receiver's counts with."""
        return {
            'sent': self.sent,
            'dropped': self.dropped,
            'damaged': self.damaged,
            'faults': [fault._asdict() for fault in faults if fault.start <= time],
        }
