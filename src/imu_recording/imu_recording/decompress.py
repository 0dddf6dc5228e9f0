# SPDX-License-Identifier: Apache-2.0
"""Compression, and decompression also of what is left of a cut chunk, message or file."""

from __future__ import annotations

import sys
from typing import Any, BinaryIO, cast

import lz4.frame  # type: ignore[import-untyped]

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

COMPRESSIONS = ('', 'zstd', 'lz4')


def decompress_chunk(
    data: memoryview, compression: str, expected: int, *, partial: bool = False
) -> Any:
    """Return the chunk's records as a bytes-like object; `partial`: as far as the data goes.

    Raises ValueError where the data is damaged or of an unknown compression.
    """
    if compression not in COMPRESSIONS:
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
    """Return a zstd-compressed message; raise ValueError where it is damaged."""
    try:
        return zstd.decompress(data)
    except zstd.ZstdError as error:
        raise ValueError(f'a message does not decompress ({error})') from None


def open_decompressed(path: Any) -> BinaryIO:
    """Open a zstd-compressed file for reading from front to back."""
    return cast('BinaryIO', zstd.open(path, 'rb'))


DAMAGE = (zstd.ZstdError, EOFError)
"""What reading a damaged or cut compressed file raises."""
