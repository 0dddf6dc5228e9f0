# SPDX-License-Identifier: Apache-2.0
"""Write recordings to a bag, each message where a reader needs it to rebuild every row."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer, WriterError

from imu_recording.bags.decoding.cdr import ENCAPSULATION, LAYOUTS, encode_messages
from imu_recording.bags.decoding.message_types import standard_types
from imu_recording.bags.metadata import INFINITE_DURATION
from imu_recording.logging_contract import (
    IMU,
    IMU_TOPIC,
    MAGNETIC_TOPIC,
    METADATA_KEYS,
    PHASE_TOPIC,
    TEMPERATURE_TOPIC,
    TRACKS,
    Track,
)
from imu_recording.recording import (
    PHASES,
    SECOND_NS,
    BagError,
    FloatArray,
    ImuRecording,
    IntArray,
)

STORAGES = {'mcap': StoragePlugin.MCAP, 'sqlite3': StoragePlugin.SQLITE3}
BAG_COMPRESSIONS = {
    'zstd': CompressionMode.STORAGE,
    'none': CompressionMode.NONE,
    'message': CompressionMode.MESSAGE,
    'file': CompressionMode.FILE,
}
_FOREVER = QosTime(**INFINITE_DURATION)
RELIABLE_QOS = Qos(
    history=QosHistory.KEEP_LAST,
    depth=500,
    reliability=QosReliability.RELIABLE,
    durability=QosDurability.VOLATILE,
    deadline=_FOREVER,
    lifespan=_FOREVER,
    liveliness=QosLiveliness.AUTOMATIC,
    liveliness_lease_duration=_FOREVER,
    avoid_ros_namespace_conventions=False,
)
"""QoS of the nodes' publishers."""
LATCHED_QOS = RELIABLE_QOS._replace(depth=1, durability=QosDurability.TRANSIENT_LOCAL)
"""QoS of the phase: late subscribers still get it, also from a replay."""
STAMP_LIMIT_NS = (1 << 31) * SECOND_NS
"""builtin_interfaces/Time counts seconds in 31 bits [ns]."""
ROWS_PER_STRETCH = 1 << 14
"""Rows serialised at a time, so that memory stays bounded."""


@dataclass(frozen=True)
class _Part:
    """A stretch of one recording's rows and the connections they are written to."""

    tracks: list[EncodedTrack]
    connections: dict[str, Connection]


def write_bag(
    recordings: ImuRecording | Sequence[ImuRecording],
    path: str | PathLike[str],
    *,
    storage: str = 'mcap',
    compression: str = 'zstd',
    metadata: Mapping[str, str] | None = None,
) -> None:
    """Write one recording, or several devices each in its namespace, to a new bag folder.

    Time of receipt is the stamp; among equal stamps chamber tracks come first, then temperature,
    Imu, MagneticField. The same input gives the same files. `storage` is 'mcap' or 'sqlite3',
    `compression` 'zstd' (of chunks; sqlite3 has none), 'none', 'message' or 'file'; `metadata`
    stands in its custom_data beside that of the logging contract.
    """
    parts = [recordings] if isinstance(recordings, ImuRecording) else list(recordings)
    path = Path(path)
    _check(parts, path, storage, compression)
    writer = Writer(path, version=9, storage_plugin=STORAGES[storage])
    if storage == 'mcap' or compression != 'zstd':
        writer.set_compression(BAG_COMPRESSIONS[compression], CompressionFormat.ZSTD)
    for key, value in (*_metadata(parts), *(metadata or {}).items()):
        writer.set_custom_data(key, value)
    try:
        with writer:
            _write(writer, parts)
    except (OSError, WriterError) as error:
        shutil.rmtree(path, ignore_errors=True)
        reason = error.strerror if isinstance(error, OSError) else error
        raise BagError(f'{path}: cannot be written ({reason})') from None


def _check(parts: Sequence[ImuRecording], path: Path, storage: str, compression: str) -> None:
    if not parts:
        raise BagError(f'{path}: no recording to write')
    if storage not in STORAGES:
        raise BagError(f'storage {storage!r} is none of {", ".join(STORAGES)}')
    if compression not in BAG_COMPRESSIONS:
        raise BagError(f'compression {compression!r} is none of {", ".join(BAG_COMPRESSIONS)}')
    if path.exists():
        raise BagError(f'{path}: exists already; remove it or name another')
    spaces = [part.namespace for part in parts]
    if len(set(spaces)) < len(spaces):
        raise BagError(f'{path}: several recordings need different namespaces, got {spaces}')
    for part in parts:
        device = part.device or 'the device'
        if not len(part):
            raise BagError(f'{path}: the recording of {device} has no samples')
        if np.any(np.diff(part.stamp) <= 0):
            raise BagError(f'{path}: stamps of {device} do not increase')
        if part.stamp[0] < 0 or part.stamp[-1] >= STAMP_LIMIT_NS:
            raise BagError(f'{path}: stamps of {device} are outside 1970 … 2038')


def _metadata(parts: Sequence[ImuRecording]) -> Iterator[tuple[str, str]]:
    """Give custom_data: plain keys where all devices agree, else one per namespace."""
    for key in METADATA_KEYS:
        values = [getattr(part, key) for part in parts]
        if len(set(values)) == 1:
            if values[0]:
                yield key, values[0]
            continue
        for part, value in zip(parts, values, strict=True):
            yield f'{part.namespace}/{key}', value


def _write(writer: Writer, parts: Sequence[ImuRecording]) -> None:
    types = standard_types()
    connections = [
        {
            track.topic: writer.add_connection(
                f'{part.namespace}/{track.topic}',
                track.message_type,
                typestore=types,
                offered_qos_profiles=(
                    LATCHED_QOS if track.topic == PHASE_TOPIC else RELIABLE_QOS,
                ),
            )
            for track in recorded_tracks(part)
        }
        for part in parts
    ]
    for stretch in _stretches(parts):
        _write_merged(
            writer,
            [
                _Part(encode_tracks(parts[k], first, last), connections[k])
                for k, first, last in stretch
            ],
        )


def _stretches(parts: Sequence[ImuRecording]) -> Iterator[list[tuple[int, int, int]]]:
    """Cut all recordings at common times, into stretches of at most ROWS_PER_STRETCH rows each."""
    at = [0] * len(parts)
    while True:
        open_parts = [k for k, part in enumerate(parts) if at[k] < len(part)]
        if not open_parts:
            return
        limit = min(int(parts[k].stamp[at[k] : at[k] + ROWS_PER_STRETCH][-1]) for k in open_parts)
        stretch = []
        for k in open_parts:
            last = int(np.searchsorted(parts[k].stamp, limit, side='right'))
            if last > at[k]:
                stretch.append((k, at[k], last))
                at[k] = last
        yield stretch


def _write_merged(writer: Writer, parts: Iterable[_Part]) -> None:
    """Write tracks in order of time; among equal stamps in the order of the tracks."""
    stamps, sources, rows = [], [], []
    tracks: list[tuple[Connection, EncodedTrack]] = []
    for part in parts:
        for track in part.tracks:
            if len(track.stamp):
                sources.append(np.full(len(track.stamp), len(tracks)))
                rows.append(np.arange(len(track.stamp)))
                stamps.append(track.stamp)
                tracks.append((part.connections[track.topic], track))
    stamp, source, row = (np.concatenate(a) for a in (stamps, sources, rows))
    rank = np.array([track.rank for _, track in tracks])[source]
    order = np.lexsort((source, rank, stamp))
    messages = [track.messages for _, track in tracks]
    connection = [c for c, _ in tracks]
    write = writer.write
    for s, k, i in zip(
        stamp[order].tolist(), source[order].tolist(), row[order].tolist(), strict=True
    ):
        write(connection[k], s, messages[k][i])


REPEAT_INTERVAL_NS = 10 * SECOND_NS
"""A track that does not change is repeated at this interval [ns]."""
RANK_OF_TOPIC = {TEMPERATURE_TOPIC: 1, IMU_TOPIC: 2, MAGNETIC_TOPIC: 3}
"""Order among equal stamps; chamber tracks come first."""
NO_ORIENTATION_DOUBLES = {4: -1.0}
"""orientation_covariance[0] of an Imu that reports no orientation (REP-145)."""


@dataclass(frozen=True)
class EncodedTrack:
    """Serialised messages of one topic."""

    topic: str
    message_type: str
    rank: int
    stamp: IntArray
    messages: Sequence[Any]


def recorded_tracks(recording: ImuRecording) -> list[Track]:
    """Return the tracks the recording has; one that is NaN throughout was not recorded."""
    recorded = []
    for track in TRACKS:
        values = [getattr(recording, field) for field in track.fields]
        if all(value is None for value in values):
            continue
        absent = track.topic in (MAGNETIC_TOPIC, TEMPERATURE_TOPIC) and np.isnan(values[0]).all()
        if not absent:
            recorded.append(track)
    return recorded


def encode_tracks(recording: ImuRecording, first: int, last: int) -> list[EncodedTrack]:
    """Return the messages of rows first … last − 1 of every track the recording has."""
    return [_encoded(track, recording, first, last) for track in recorded_tracks(recording)]


def _encoded(track: Track, recording: ImuRecording, first: int, last: int) -> EncodedTrack:
    rank = RANK_OF_TOPIC.get(track.topic, 0)
    if track.topic == PHASE_TOPIC:
        rows = _phase_rows(recording, first, last)
        messages: Sequence[Any] = _phase_messages(recording, rows)
    else:
        groups = [getattr(recording, field) for field in track.fields]
        measured = recording.stamp
        if track.topic == TEMPERATURE_TOPIC and recording.temperature_stamp is not None:
            measured = recording.temperature_stamp
            rows = first + np.flatnonzero(_changed(measured, first, last))
            rows = rows[measured[rows] >= 0]
        else:
            rows = _rows_to_send(track, recording.stamp, groups, first, last)
        count = LAYOUTS[track.message_type].columns[0].count
        taken = tuple(group[rows].reshape(len(rows), count) for group in groups)
        constants = NO_ORIENTATION_DOUBLES if track.message_type == IMU else None
        frame = '' if track.shared else recording.frame_id
        records = encode_messages(track.message_type, measured[rows], frame, taken, constants)
        size = records.shape[1]
        view = memoryview(records.tobytes())
        messages = [view[at : at + size] for at in range(0, len(view), size)]
    return EncodedTrack(
        topic=track.topic,
        message_type=track.message_type,
        rank=rank,
        stamp=recording.stamp[rows],
        messages=messages,
    )


def _rows_to_send(
    track: Track, stamp: IntArray, groups: Sequence[FloatArray], first: int, last: int
) -> IntArray:
    """Return the rows whose sample must be sent so that a reader rebuilds every row."""
    rows = np.arange(first, last)
    values = groups[0]
    if track.topic == IMU_TOPIC:
        return rows
    absent = np.isnan(values[first:last].reshape(len(rows), -1)).all(axis=1)
    if track.topic == MAGNETIC_TOPIC:
        return rows[~absent]
    send = np.ones(len(rows), bool)
    if track.topic != TEMPERATURE_TOPIC:
        send = _changed(values, first, last) | _due(stamp, first, last)
    if absent.any():
        begun = np.maximum.accumulate(~absent)
        if not begun.all() and first and not np.isnan(values[:first]).all():
            begun[:] = True
        send &= begun  # nothing is sent before the first sample
    return rows[send]


def _changed(values: NDArray[Any], first: int, last: int) -> NDArray[np.bool_]:
    """Tell which rows differ from the row before in any bit; the first row of all does."""
    words = np.ascontiguousarray(values[max(first - 1, 0) : last]).view(np.int64)
    words = words.reshape(last - max(first - 1, 0), -1)
    changed = (words[1:] != words[:-1]).any(axis=1)
    return changed if first else np.concatenate(([True], changed))


def _due(stamp: IntArray, first: int, last: int) -> NDArray[np.bool_]:
    """Tell which rows are the first of a new repetition interval."""
    turn = (stamp[max(first - 1, 0) : last] - stamp[0]) // REPEAT_INTERVAL_NS
    due = np.diff(turn) > 0
    return due if first else np.concatenate(([True], due))


def _phase_rows(recording: ImuRecording, first: int, last: int) -> IntArray:
    send = np.zeros(last - first, bool)
    for values in (recording.phase, recording.cycle):
        if values is not None:
            send |= _changed(values, first, last)
    return np.arange(first, last)[send]


def _phase_messages(recording: ImuRecording, rows: IntArray) -> list[bytes]:
    n = len(rows)
    phase = recording.phase[rows] if recording.phase is not None else np.full(n, -1)
    cycle = recording.cycle[rows] if recording.cycle is not None else np.zeros(n, int)
    messages = []
    for p, c in zip(phase.tolist(), cycle.tolist(), strict=True):
        text = f'{PHASES[p] if 0 <= p < len(PHASES) else "unknown"} {c}'.encode() + b'\0'
        messages.append(ENCAPSULATION + len(text).to_bytes(4, 'little') + text)
    return messages
