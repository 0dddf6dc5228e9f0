# SPDX-License-Identifier: Apache-2.0
"""The end of a closed mcap file: where data and summary lie, and whether their checksums hold.

A checksum of 0 was not computed by the writer. Format: https://mcap.dev/spec, version 0.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import BinaryIO

from imu_recording.bags.mcap.writer import DATA_END, FOOTER, MAGIC

LARGEST_SUMMARY_BYTES = 256 << 20
"""A summary that claims to be larger is damage [bytes]."""
BLOCK_BYTES = 1 << 22
"""Bytes of a file that are read at a time."""
_FOOTER = struct.Struct('<BQQQI8s')
_FOOTER_BYTES = 20
_CHECKED_FOOTER_BYTES = 25
"""Bytes of the footer that the checksum of the summary covers."""
_DATA_END = struct.Struct('<BQI')


@dataclass(frozen=True)
class McapFooter:
    """Content of a file's last record, and where it is."""

    place: int
    """Place of the footer in the file [bytes]."""
    summary_start: int
    """0 where there is no summary."""
    summary_checksum: int
    head: bytes
    """The footer's bytes that its checksum covers."""

    @property
    def data_end(self) -> int:
        """Place of the record that ends the data section."""
        return (self.summary_start or self.place) - _DATA_END.size


def read_footer(stream: BinaryIO) -> McapFooter | None:
    """Return the footer, None where the file does not end with a usable one."""
    size = stream.seek(0, 2)
    place = size - _FOOTER.size
    if place < len(MAGIC) + _DATA_END.size:
        return None
    stream.seek(place)
    content = stream.read(_FOOTER.size)
    opcode, length, start, _, checksum, magic = _FOOTER.unpack(content)
    if opcode != FOOTER or length != _FOOTER_BYTES or magic != MAGIC or start > place:
        return None
    if start and not len(MAGIC) + _DATA_END.size <= start >= place - LARGEST_SUMMARY_BYTES:
        return None
    return McapFooter(
        place=place,
        summary_start=start,
        summary_checksum=checksum,
        head=content[:_CHECKED_FOOTER_BYTES],
    )


def summary_bytes(stream: BinaryIO, footer: McapFooter) -> bytes | None:
    """Return the summary, None where there is none or its checksum is wrong."""
    if not footer.summary_start:
        return None
    stream.seek(footer.summary_start)
    summary = stream.read(footer.place - footer.summary_start)
    wanted = footer.summary_checksum
    if wanted and zlib.crc32(footer.head, zlib.crc32(summary)) != wanted:
        return None
    return summary


def checksum_faults(stream: BinaryIO) -> list[str]:
    """Return which checksums of a whole file are wrong: that of its data, that of its summary."""
    footer = read_footer(stream)
    if footer is None:
        return []
    faults = []
    wanted = _data_checksum(stream, footer)
    if wanted and _checksum(stream, footer.data_end) != wanted:
        faults.append(
            'the checksum of its data is wrong: what has no checksum of its own may be damaged'
        )
    if footer.summary_start and summary_bytes(stream, footer) is None:
        faults.append('the checksum of its summary is wrong: the summary is not used')
    return faults


def _data_checksum(stream: BinaryIO, footer: McapFooter) -> int:
    stream.seek(footer.data_end)
    content = stream.read(_DATA_END.size)
    if len(content) < _DATA_END.size:
        return 0
    opcode, length, checksum = _DATA_END.unpack(content)
    return int(checksum) if (opcode, length) == (DATA_END, 4) else 0


def _checksum(stream: BinaryIO, end: int) -> int:
    """Return the CRC-32 of the first `end` bytes."""
    stream.seek(0)
    checksum = 0
    while end > 0:
        block = stream.read(min(end, BLOCK_BYTES))
        if not block:
            break
        checksum = zlib.crc32(block, checksum)
        end -= len(block)
    return checksum
