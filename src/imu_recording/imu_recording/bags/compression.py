# SPDX-License-Identifier: Apache-2.0
"""Compression, and decompression also of what is left of a cut chunk, message or file."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Any

import lz4.frame  # type: ignore[import-untyped]

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
CHUNK_COMPRESSIONS = ('', 'zstd', 'lz4')


def decompress_chunk(
    data: memoryview, compression: str, expected: int, *, partial: bool = False
) -> Any:
    """Return the chunk's records as a bytes-like object; `partial`: as far as the data goes.

    Raises ValueError where the data is damaged or of an unknown compression.
    """
    if compression not in CHUNK_COMPRESSIONS:
        raise ValueError(f'compression {compression!r} is none of none, zstd, lz4')
    if not compression:
        result: Any = data
    elif partial:
        return _as_far_as_possible(data, compression)
    else:
        try:
            whole = zstd.decompress if compression == 'zstd' else lz4.frame.decompress
            result = whole(data)
        except (zstd.ZstdError, RuntimeError, EOFError) as error:
            raise ValueError(f'it does not decompress ({error})') from None
    if not partial and len(result) != expected:
        raise ValueError(f'it has {len(result)} bytes, its header says {expected}')
    return result


def compress_chunk(data: bytes, compression: str) -> bytes:
    """Return the data compressed as a chunk's records are."""
    if compression == 'zstd':
        return bytes(zstd.compress(data))
    if compression == 'lz4':
        return bytes(lz4.frame.compress(data))
    return data


def _as_far_as_possible(data: memoryview, compression: str) -> bytes:
    zstandard = compression == 'zstd'
    decompressor: Any = zstd.ZstdDecompressor() if zstandard else lz4.frame.LZ4FrameDecompressor()
    done = bytearray()
    step = 4096
    for at in range(0, len(data), step):
        try:
            done += decompressor.decompress(bytes(data[at : at + step]))
        except (zstd.ZstdError, RuntimeError, EOFError):
            break
    return bytes(done)


def decompress_message(data: bytes) -> bytes:
    """Return a zstd-compressed message; b'' (no message is empty) where it is damaged."""
    try:
        return zstd.decompress(data)
    except zstd.ZstdError:
        return b''


class ZstdFile(io.RawIOBase):
    """A zstd-compressed file read from front to back, as far as it goes.

    Where it is cut or damaged it simply ends; `damage` then says why.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self._ready = memoryview(b'')
        self._place = 0
        self._ended = False
        self.damage = ''
        self._restart()

    def readable(self) -> bool:
        """Tell that it can be read."""
        return True

    def readinto(self, view: Any) -> int:
        """Fill the view; return the bytes read, 0 at the end."""
        while not self._ready and not self._ended:
            self._decompress_more()
        count = min(len(view), len(self._ready))
        view[:count] = self._ready[:count]
        self._ready = self._ready[count:]
        self._place += count
        return count

    def seek(self, place: int, whence: int = io.SEEK_SET) -> int:
        """Go to a byte of the decompressed file."""
        if whence != io.SEEK_SET:
            raise ValueError('a compressed file is read from its start')
        if place < self._place:
            self._file.close()
            self._restart()
        while self._place < place and self.read(min(1 << 20, place - self._place)):
            pass
        return self._place

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        super().close()

    def _restart(self) -> None:
        self._file = self._path.open('rb')
        self._decompressor = zstd.ZstdDecompressor()
        self._ready = memoryview(b'')
        self._place = 0
        self._ended = False
        self.damage = ''

    def _decompress_more(self) -> None:
        packed = b''
        if self._decompressor.eof:
            packed = self._decompressor.unused_data
            self._decompressor = zstd.ZstdDecompressor()
        packed = packed or self._file.read(1 << 16)
        if not packed:
            self._ended = True
            return
        try:
            self._ready = memoryview(self._decompressor.decompress(packed))
        except zstd.ZstdError as error:
            self._ended = True
            self.damage = str(error)
