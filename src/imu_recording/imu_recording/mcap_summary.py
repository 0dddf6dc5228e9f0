# SPDX-License-Identifier: Apache-2.0
"""Topics and message counts from the summary at the end of a closed mcap file."""

from __future__ import annotations

import struct
from pathlib import Path

from imu_recording.mcap_records import CHANNEL, MAGIC, SCHEMA, STATISTICS
from imu_recording.mcap_scan import Channel, McapScan

LARGEST_SUMMARY = 256 << 20
"""A summary that claims to be larger is damage [bytes]."""
_FOOTER = struct.Struct('<BQQQI8s')
_COUNTS_AT = 8 + 2 + 4 + 4 + 4 + 4 + 8 + 8


def read_summary(path: Path) -> dict[str, tuple[str, int]] | None:
    """Return message type and count by topic, or None where the file has no usable summary."""
    with path.open('rb') as stream:
        size = stream.seek(0, 2)
        if size < _FOOTER.size + len(MAGIC):
            return None
        stream.seek(size - _FOOTER.size)
        opcode, length, start, _, _, magic = _FOOTER.unpack(stream.read(_FOOTER.size))
        if opcode != 2 or length != 20 or magic != MAGIC:
            return None
        if not 0 < start < size or size - start > LARGEST_SUMMARY:
            return None
        stream.seek(start)
        summary = stream.read(size - _FOOTER.size - start)
    return _parse_summary(summary)


def _parse_summary(summary: bytes) -> dict[str, tuple[str, int]] | None:
    scan = McapScan(select=lambda _: -1, deliver=lambda _: None)
    counts: dict[int, int] | None = None
    at = 0
    while at + 9 <= len(summary):
        opcode, size = summary[at], int.from_bytes(summary[at + 1 : at + 9], 'little')
        content = summary[at + 9 : at + 9 + size]
        at += 9 + size
        if opcode in (SCHEMA, CHANNEL):
            scan.declare(opcode, content)
        elif opcode == STATISTICS and len(content) >= _COUNTS_AT + 4:
            pairs = content[_COUNTS_AT + 4 :]
            counts = dict(struct.iter_unpack('<HQ', pairs[: len(pairs) // 10 * 10]))
    if counts is None or not set(counts) <= set(scan.channels):
        return None
    return _by_topic(scan.channels, counts)


def _by_topic(
    channels: dict[int, Channel], counts: dict[int, int]
) -> dict[str, tuple[str, int]] | None:
    topics: dict[str, tuple[str, int]] = {}
    for key, channel in channels.items():
        kind, count = topics.get(channel.topic, (channel.message_type, 0))
        if kind != channel.message_type or not kind:
            return None
        topics[channel.topic] = (kind, count + counts.get(key, 0))
    return topics
