# SPDX-License-Identifier: Apache-2.0
"""Read a bag of any kind into an ImuRecording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path

from imu_recording.assemble import assemble_recording
from imu_recording.bag_error import BagError
from imu_recording.bag_files import Bag, locate_bag
from imu_recording.bag_scan import scan_file, topics_of_file
from imu_recording.bag_topics import choose_topics, namespaces_of
from imu_recording.logging_contract import IMU, METADATA_KEYS
from imu_recording.odd_message import OddMessageError
from imu_recording.recording import ImuRecording
from imu_recording.topic_columns import TopicColumns

BagPath = str | PathLike[str]


def read_bag(
    path: BagPath | Sequence[BagPath],
    *,
    namespace: str | None = None,
    remap: Mapping[str, str] | None = None,
) -> ImuRecording:
    """Read a bag: rosbag2 mcap or sqlite3, whole, cut or unclosed, or a ROS 1 bag.

    `path` is a bag folder or a single storage file; several paths are parts of one recording,
    joined in time. `namespace` chooses among several devices. `remap` maps names of the logging
    contract to names in the bag ('imu/data_raw': 'sensor/imu'; '' leaves a track out). What was
    dropped, repaired or inferred stands in `notes`. Raises BagError.
    """
    bags = [locate_bag(part) for part in _paths(path)]
    name = str(bags[0].path) if len(bags) == 1 else f'{bags[0].path} … {bags[-1].path}'
    types, counts = _topics(bags)
    space, chosen = choose_topics(types, namespace, remap, name)
    metadata = _metadata(bags, space)
    columns = {topic: TopicColumns(track, topic, counts[topic]) for topic, track in chosen.items()}
    notes = [note for bag in bags for note in bag.notes]
    for bag in bags:
        for file in bag.files:
            try:
                notes += scan_file(file, columns, metadata, space)
            except OddMessageError as error:
                raise BagError(f'{file.path}: {error}') from None
            except OSError as error:
                raise BagError(f'{file.path}: {error.strerror or error}') from None
    _refuse_empty(name, columns)
    return assemble_recording(columns, metadata, space, name, notes)


def bag_namespaces(path: BagPath) -> list[str]:
    """Return the namespaces of the devices in a bag ('' for one without), in order."""
    return namespaces_of(_topics([locate_bag(path)])[0])


def _paths(path: BagPath | Sequence[BagPath]) -> list[Path]:
    if isinstance(path, str | PathLike):
        return [Path(path)]
    if not path:
        raise BagError('no bag given')
    return [Path(part) for part in path]


def _topics(bags: Iterable[Bag]) -> tuple[dict[str, set[str]], dict[str, int]]:
    """Return message types by topic and the number of messages expected."""
    types: dict[str, set[str]] = {}
    counts: dict[str, int] = {}
    for bag in bags:
        for file in bag.files:
            try:
                topics = topics_of_file(file)
            except OSError as error:
                raise BagError(f'{file.path}: {error.strerror or error}') from None
            for topic, (message_type, count) in topics.items():
                types.setdefault(topic, set()).add(message_type)
                plausible = min(count, file.path.stat().st_size)  # a byte per message at least
                counts[topic] = counts.get(topic, 0) + plausible
    return types, counts


def _metadata(bags: Sequence[Bag], space: str) -> dict[str, str]:
    """Return device, run, up_axis and profile, those of the namespace before those of the bag."""
    metadata: dict[str, str] = {}
    for bag in bags:
        for key in METADATA_KEYS:
            value = bag.custom.get(f'{space}/{key}', bag.custom.get(key, ''))
            if not value:
                continue
            if key in ('device', 'up_axis') and metadata.get(key, value) != value:
                raise BagError(
                    f'{bag.path}: {key} is {value}, that of {bags[0].path} is {metadata[key]}; '
                    'only parts of one recording can be joined'
                )
            metadata.setdefault(key, value)
    return metadata


def _refuse_empty(name: str, columns: Mapping[str, TopicColumns]) -> None:
    imu = next((topic for topic, c in columns.items() if c.track.message_type == IMU), '')
    damaged = columns[imu].undecodable
    if damaged and not columns[imu].count:
        raise BagError(
            f'{name}: none of the {damaged} messages on {imu} is a {IMU}; '
            'was another type recorded under this name?'
        )
    if not columns[imu].count:
        raise BagError(f'{name}: no samples on {imu}; the recording ended before the first')
