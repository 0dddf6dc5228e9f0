# SPDX-License-Identifier: Apache-2.0
"""Which topics of a bag make the recording of one device."""

from __future__ import annotations

from collections.abc import Mapping

from imu_recording.bag_error import BagError
from imu_recording.logging_contract import IMU, IMU_TOPIC, TRACK_OF_TOPIC, TRACKS, Track


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
