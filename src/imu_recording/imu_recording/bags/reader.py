# SPDX-License-Identifier: Apache-2.0
"""Read a bag of any kind into an ImuRecording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path

from imu_recording.bags.assemble import assemble_recording
from imu_recording.bags.decoding.message_types import DecodeError
from imu_recording.bags.decoding.topic_columns import TopicColumns
from imu_recording.bags.files import Bag, locate_bag
from imu_recording.bags.scan import scan_columns, topics_of_file
from imu_recording.logging_contract import (
    APPLIED_MODEL,
    COMPENSATED,
    IMU,
    IMU_TOPIC,
    MAGNETIC_TOPIC,
    MESSAGES_LOST,
    METADATA_KEYS,
    STRING,
    TEMPERATURE,
    TEMPERATURE_TOPIC,
    TRACK_OF_TOPIC,
    TRACKS,
    Track,
)
from imu_recording.recording import BagError, ImuRecording

COMPENSATED_IMU = f'{COMPENSATED}/{IMU_TOPIC.rpartition("/")[2]}'
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
    remap = _with_compensated(types, namespace, remap, bags)
    space, chosen = choose_topics(types, namespace, remap, name)
    metadata = _metadata(bags, space)
    columns = {topic: TopicColumns(track, topic, counts[topic]) for topic, track in chosen.items()}
    applied_topic = _applied_topic(types, chosen)
    if applied_topic:
        columns[applied_topic] = TopicColumns(Track(APPLIED_MODEL, STRING, ()), applied_topic, 1)
    notes = [note for bag in bags for note in bag.notes]
    notes += _temperature_topics(types, chosen)
    notes += [
        note for bag in bags if (note := lost_note(bag.custom.get(MESSAGES_LOST, ''), space))
    ]
    for bag in bags:
        for file in bag.files:
            try:
                notes += scan_columns(file, columns, metadata, space)
            except DecodeError as error:
                raise BagError(f'{file.path}: {error}') from None
            except OSError as error:
                raise BagError(f'{file.path}: {error.strerror or error}') from None
    _refuse_empty(name, columns)
    models = columns.pop(applied_topic).texts if applied_topic else []
    if models:
        metadata['compensated'] = models[-1]
        if len(set(models)) > 1:
            names = ', '.join(sorted({text or 'none' for text in models}))
            notes.append(
                f'{applied_topic}: not one model was subtracted from all of it, but {names}'
            )
    elif metadata.get('compensated') and _is_raw(types, space, chosen):
        del metadata['compensated']
    return assemble_recording(columns, metadata, space, name, notes)


def _temperature_topics(types: Mapping[str, set[str]], chosen: Mapping[str, Track]) -> list[str]:
    """Return which topics may hold the die temperature where none of the contract's name does."""
    if any(track.topic == TEMPERATURE_TOPIC for track in chosen.values()):
        return []
    found = sorted(t for t, kinds in types.items() if TEMPERATURE in kinds and t not in chosen)
    if not found:
        return []
    way = f'take one with --topic {TEMPERATURE_TOPIC}:={found[0]}'
    return [f'no topic {TEMPERATURE_TOPIC}, but temperatures on {_listed(found)}; {way}']


def chosen_topics(
    bag: Bag, namespace: str | None, remap: Mapping[str, str] | None
) -> tuple[str, dict[str, str]]:
    """Return the namespace, and name of the logging contract → topic, that `read_bag` takes."""
    types, _ = _topics([bag])
    remap = _with_compensated(types, namespace, remap, [bag])
    space, chosen = choose_topics(types, namespace, remap, str(bag.path))
    return space, {track.topic: topic for topic, track in chosen.items()}


def _with_compensated(
    types: Mapping[str, set[str]],
    namespace: str | None,
    remap: Mapping[str, str] | None,
    bags: Sequence[Bag],
) -> Mapping[str, str]:
    """Return the remap that takes the compensated topics of a bag that was written with them."""
    remap = dict(remap or {})
    written = any(key.rpartition('/')[2] == 'compensated' for bag in bags for key in bag.custom)
    spaces = [t.removesuffix(f'/{COMPENSATED_IMU}') for t in types if t.endswith(COMPENSATED_IMU)]
    if namespace is not None:
        spaces = [space for space in spaces if space.strip('/') == namespace.strip('/')]
    if not written or len(spaces) != 1 or IMU_TOPIC in remap:
        return remap
    for name in (IMU_TOPIC, MAGNETIC_TOPIC):
        topic = f'{spaces[0]}/{COMPENSATED}/{name.rpartition("/")[2]}'
        if topic in types:
            remap.setdefault(name, topic)
    return remap


def _applied_topic(types: Mapping[str, set[str]], chosen: Mapping[str, Track]) -> str:
    """Return the topic that tells which model was subtracted from the chosen Imu, '' for none."""
    imu = next((topic for topic, track in chosen.items() if track.topic == IMU_TOPIC), '')
    topic = f'{imu.rpartition("/")[0]}/{APPLIED_MODEL}'
    return topic if types.get(topic) == {STRING} else ''


def _is_raw(types: Mapping[str, set[str]], space: str, chosen: Mapping[str, Track]) -> bool:
    """Tell whether what was measured was read beside compensated topics."""
    beside = f'{space}/{COMPENSATED_IMU}'
    return beside in types and beside not in chosen


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


def lost_note(lost: str, space: str) -> str:
    """Return what a recorder says it did not get, of a namespace and of topics outside of any.

    >>> lost_note('/dut1/imu/mag 7, /dut2/imu/mag 2, /chamber/phase 1', '/dut1')
    'the recorder lost 8 messages: 7 on /dut1/imu/mag, 1 on /chamber/phase'
    """
    pairs = [entry.strip().rpartition(' ') for entry in lost.split(',') if entry.strip()]
    counts = {
        topic: int(number)
        for topic, _, number in pairs
        if number.isdecimal() and topic.startswith((f'{space}/', '/chamber/'))
    }
    listed = ', '.join(f'{number} on {topic}' for topic, number in counts.items())
    return f'the recorder lost {sum(counts.values())} messages: {listed}' if counts else ''


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


def namespaces_of(types: Mapping[str, set[str]]) -> list[str]:
    """Return the namespaces ('' for none) that have an Imu on imu/data_raw.

    >>> namespaces_of({'/dut1/imu/data_raw': {IMU}, '/imu/data': {IMU}})
    ['/dut1']
    """
    ending = f'/{IMU_TOPIC}'
    return sorted(t.removesuffix(ending) for t in types if t.endswith(ending) and IMU in types[t])


def choose_topics(
    types: Mapping[str, set[str]],
    namespace: str | None,
    remap: Mapping[str, str] | None,
    name: str,
) -> tuple[str, dict[str, Track]]:
    """Return the namespace and the bag's topics that fill the tracks of one device.

    `types` maps the bag's topics to their message types. `remap` maps names of the logging
    contract to names in the bag (relative ones within the namespace, '' leaves a track out).
    """
    renamed = {key.strip('/'): value for key, value in (remap or {}).items()}
    unknown = sorted(set(renamed) - set(TRACK_OF_TOPIC))
    if unknown:
        known = ', '.join(TRACK_OF_TOPIC)
        raise BagError(f'remap of {unknown[0]!r}: no such name in a recording; known: {known}')
    space = _namespace(types, namespace, renamed, name)
    devices = set(namespaces_of(types))
    chosen: dict[str, Track] = {}
    for track in TRACKS:
        topic = _topic_of(track, types, space, renamed, devices, name)
        if topic is None:
            continue
        if types[topic] != {track.message_type}:
            kinds = ', '.join(sorted(types[topic]))
            raise BagError(
                f'{name}: topic {topic} is {kinds}, expected {track.message_type}; '
                f'name another with --topic {track.topic}:=other or none with {track.topic}:='
            )
        chosen[topic] = track
    return space, chosen


def _namespace(
    types: Mapping[str, set[str]], namespace: str | None, renamed: Mapping[str, str], name: str
) -> str:
    spaces = namespaces_of(types)
    if namespace is not None:
        space = '/' + namespace.strip('/') if namespace.strip('/') else ''
        if space not in spaces and IMU_TOPIC not in renamed:
            raise BagError(
                f'{name}: no {IMU_TOPIC} in namespace {namespace!r}; '
                f'namespaces that have one: {_listed(spaces)}'
            )
        return space
    if IMU_TOPIC in renamed:
        return spaces[0] if len(spaces) == 1 else ''
    if len(spaces) == 1:
        return spaces[0]
    if spaces:
        raise BagError(f'{name}: several devices; choose one with --namespace: {_listed(spaces)}')
    if f'/{IMU_TOPIC}' in types:
        return ''  # present with another type: said when topics are chosen
    if not types:
        raise BagError(f'{name}: no topics in it; it is damaged or ended before its first message')
    others = sorted(topic for topic in types if IMU in types[topic])
    way = f'; name one with --topic {IMU_TOPIC}:={others[0]}' if others else ''
    raise BagError(f'{name}: no topic {IMU_TOPIC}; it has {_listed(sorted(types))}{way}')


def _topic_of(
    track: Track,
    types: Mapping[str, set[str]],
    space: str,
    renamed: Mapping[str, str],
    devices: set[str],
    name: str,
) -> str | None:
    if track.topic in renamed:
        other = renamed[track.topic]
        if not other:
            return None
        topic = other if other.startswith('/') else f'{space}/{other}'
        if topic not in types:
            raise BagError(f'{name}: no topic {topic!r}; it has {_listed(sorted(types))}')
        return topic
    places = [space]
    if track.shared:
        parts = space.split('/')
        places += ['/'.join(parts[:n]) for n in range(len(parts) - 1, 0, -1)]
    for place in places:
        if f'{place}/{track.topic}' in types:
            return f'{place}/{track.topic}'
    if not track.shared:
        return None
    ending = f'/{track.topic}'
    elsewhere = [t for t in types if t.endswith(ending) and t.removesuffix(ending) not in devices]
    return elsewhere[0] if len(elsewhere) == 1 else None


def _listed(names: list[str]) -> str:
    shown = ', '.join(name or "''" for name in names[:12])
    return (shown + (' …' if len(names) > 12 else '')) or 'none'
