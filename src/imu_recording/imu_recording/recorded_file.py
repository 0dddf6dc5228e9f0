# SPDX-License-Identifier: Apache-2.0
"""What one file of a recording holds."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from imu_recording.bag_error import BagError

if TYPE_CHECKING:
    from imu_recording.mcap_scan import Channel
    from imu_recording.topic_columns import MessageBlock


@dataclass(frozen=True)
class RecordedFile:
    """One file of the bag."""

    name: str
    first: int = 0
    """Time of receipt of the first message [ns]."""
    last: int = 0
    counts: dict[str, int] = field(default_factory=dict)
    """Messages by topic."""


def inspect_file(path: Path) -> tuple[RecordedFile, dict[str, str]]:
    """Return what an mcap file holds, closed or not, and its message types by topic."""
    from imu_recording.mcap_scan import McapScan  # only here: it brings compiled kernels

    topics: dict[str, str] = {}
    counts: list[int] = []
    span: list[int] = []

    def select(channel: Channel) -> int:
        if channel.topic not in topics:
            topics[channel.topic] = channel.message_type
            counts.append(0)
        return list(topics).index(channel.topic)

    def deliver(block: MessageBlock) -> None:
        for slot, more in enumerate(np.bincount(block.slot[: block.count]).tolist()):
            counts[slot] += more
        received = block.received[: block.count]
        span.extend((int(received.min()), int(received.max())))

    try:
        with path.open('rb') as stream:
            McapScan(select, deliver).run(stream, str(path))
    except BagError:
        return RecordedFile(path.name), {}  # died before its first bytes were written
    first, last = (min(span), max(span)) if span else (0, 0)
    return RecordedFile(path.name, first, last, dict(zip(topics, counts, strict=True))), topics
