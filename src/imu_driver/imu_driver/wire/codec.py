# SPDX-License-Identifier: Apache-2.0
"""Bytes to frames and back, sans-I/O: chunks in, whole frames out.

Chunks may be split, joined or damaged anywhere; invalid pieces are counted, nothing raises.

>>> from imu_driver.wire.frames import CommandFrame
>>> decoder = FrameDecoder('auto')
>>> wire = encode(CommandFrame(2, 1), 'binary') + encode(CommandFrame(3, 2), 'binary')
>>> decoder.feed(wire[:5]), decoder.feed(wire[5:])
([], [CommandFrame(command=2, number=1, value=0), CommandFrame(command=3, number=2, value=0)])
>>> decoder.protocol
'binary'
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from imu_driver.wire import ascii as ascii_frames
from imu_driver.wire import binary as binary_frames
from imu_driver.wire.frames import Frame, FrameError

PROTOCOLS: Final = ('auto', 'ascii', 'binary')


@dataclass
class DecoderCounts:
    """Counters of a decoder: bytes, valid frames, and invalid pieces by kind of error."""

    bytes: int = 0
    frames: int = 0
    cobs: int = 0
    crc: int = 0
    format: int = 0

    @property
    def errors(self) -> int:
        """Pieces between two delimiters that were no valid frame."""
        return self.cobs + self.crc + self.format

    def __add__(self, other: DecoderCounts) -> DecoderCounts:
        return DecoderCounts(
            bytes=self.bytes + other.bytes,
            frames=self.frames + other.frames,
            cobs=self.cobs + other.cobs,
            crc=self.crc + other.crc,
            format=self.format + other.format,
        )


def encode(frame: Frame, protocol: str) -> bytes:
    """Return the bytes of a frame in protocol 'ascii' or 'binary'."""
    if protocol == 'ascii':
        return ascii_frames.encode(frame)
    return binary_frames.encode(frame)


class _Splitter:
    """Cuts a stream of bytes into pieces at a delimiter and decodes each."""

    def __init__(self, delimiter: bytes, longest: int, decode: Callable[[bytes], Frame]) -> None:
        self.counts = DecoderCounts()
        self._delimiter = delimiter
        self._longest = longest
        self._decode = decode
        self._rest = b''
        self._overlong = False
        self._synchronised = False

    def feed(self, chunk: bytes) -> list[Frame]:
        *pieces, rest = (self._rest + chunk).split(self._delimiter)
        frames: list[Frame] = []
        for piece in pieces:
            if self._overlong or len(piece) > self._longest:
                self._reject('format')
            elif piece:
                try:
                    frames.append(self._decode(piece))
                except FrameError as error:
                    self._reject(error.kind)
            # The first piece may be the rest of a frame that began before the connection.
            self._synchronised = True
            self._overlong = False
        if len(rest) > self._longest:
            self._overlong = True
            rest = b''
        self._rest = rest
        self.counts.frames += len(frames)
        return frames

    def _reject(self, kind: str) -> None:
        if self._synchronised:
            setattr(self.counts, kind, getattr(self.counts, kind) + 1)


def _decode_line(piece: bytes) -> Frame:
    return ascii_frames.decode(piece.removesuffix(b'\r'))


class FrameDecoder:
    """Decodes one connection's bytes; 'auto' settles on the protocol of the first valid frame."""

    def __init__(self, protocol: str = 'auto') -> None:
        self._bytes = 0
        self._candidates = {
            'ascii': _Splitter(b'\n', ascii_frames.LONGEST_LINE_BYTES, _decode_line),
            'binary': _Splitter(
                binary_frames.DELIMITER, binary_frames.LONGEST_FRAME_BYTES, binary_frames.decode
            ),
        }
        if protocol != 'auto':
            self._candidates = {protocol: self._candidates[protocol]}

    @property
    def protocol(self) -> str:
        """'ascii' or 'binary', or 'auto' while undecided."""
        return next(iter(self._candidates)) if len(self._candidates) == 1 else 'auto'

    @property
    def counts(self) -> DecoderCounts:
        """Counts of this connection; errors are counted once the protocol is settled."""
        counts = DecoderCounts(bytes=self._bytes)
        if len(self._candidates) == 1:
            (splitter,) = self._candidates.values()
            counts = splitter.counts
            counts.bytes = self._bytes
        return counts

    def feed(self, chunk: bytes) -> list[Frame]:
        """Return the frames that the chunk completes, in order."""
        self._bytes += len(chunk)
        if len(self._candidates) == 1:
            (settled,) = self._candidates.values()
            return settled.feed(chunk)
        for name, splitter in tuple(self._candidates.items()):
            frames = splitter.feed(chunk)
            if frames:
                self._candidates = {name: splitter}
                # Errors counted before the protocol was known may be frames of the other one.
                splitter.counts.cobs = splitter.counts.crc = splitter.counts.format = 0
                return frames
        return []
