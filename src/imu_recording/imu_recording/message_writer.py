# SPDX-License-Identifier: Apache-2.0
"""Messages as a bag folder whose bytes depend on nothing but the messages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path

from imu_recording.bag_error import BagError
from imu_recording.bag_messages import BagMessage
from imu_recording.mcap_stream import McapStream
from imu_recording.odd_message import definition_of
from imu_recording.recorded_file import RecordedFile
from imu_recording.recorder_metadata import qos_profile, qos_text, write_metadata

CHUNK = 1 << 20
"""Bytes of messages after which a chunk is closed."""


def write_messages(
    messages: Iterable[BagMessage], types: Mapping[str, str], path: str | PathLike[str]
) -> None:
    """Write messages, in the order given, to a new mcap bag; `types` maps topic to type."""
    folder = Path(path)
    if folder.exists():
        raise BagError(f'{folder}: exists already; remove it or name another')
    folder.mkdir(parents=True)
    name = f'{folder.name}_0.mcap'
    counts: Counter[str] = Counter()
    stream = McapStream()
    profile = qos_profile(reliable=True, latched=False, depth=500)
    with (folder / name).open('wb') as file:
        file.write(stream.begin())
        channels = {
            topic: stream.add_channel(topic, kind, definition_of(kind), qos_text([profile]))
            for topic, kind in types.items()
        }
        for message in messages:
            stream.add_message(channels[message.topic], message.received, message.data)
            counts[message.topic] += 1
            if stream.pending > CHUNK:
                file.write(stream.flush())
        file.write(stream.end())
    first, last = stream.span
    written = RecordedFile(name, first, last, dict(counts))
    topics = {topic: (kind, [profile]) for topic, kind in types.items()}
    write_metadata(folder, [written], topics, {}, sync=False)
