# SPDX-License-Identifier: Apache-2.0
"""Write recordings as a rosbag2 bag that reads back equal, bit for bit."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer, WriterError

from imu_recording.bag_error import BagError
from imu_recording.encode_tracks import EncodedTrack, encode_tracks, recorded_tracks
from imu_recording.logging_contract import METADATA_KEYS
from imu_recording.odd_message import standard_types
from imu_recording.recording import ImuRecording

STORAGES = {'mcap': StoragePlugin.MCAP, 'sqlite3': StoragePlugin.SQLITE3}
COMPRESSIONS = {
    'zstd': CompressionMode.STORAGE,
    'none': CompressionMode.NONE,
    'message': CompressionMode.MESSAGE,
    'file': CompressionMode.FILE,
}
END_OF_STAMPS = (1 << 31) * 1_000_000_000
"""builtin_interfaces/Time counts seconds in 31 bits [ns]."""
ROWS = 1 << 14
"""Rows serialised at a time, so that memory stays bounded."""


@dataclass(frozen=True)
class _Part:
    """A stretch of one recording's rows and where they go."""

    tracks: list[EncodedTrack]
    connections: dict[str, Connection]


def write_bag(
    recordings: ImuRecording | Sequence[ImuRecording],
    path: str | PathLike[str],
    *,
    storage: str = 'mcap',
    compression: str = 'zstd',
) -> None:
    """Write one recording, or several devices each in its namespace, to a new bag folder.

    Time of receipt is the stamp; among equal stamps chamber tracks come first, then temperature,
    Imu, MagneticField. The same input gives the same files. `storage` is 'mcap' or 'sqlite3',
    `compression` 'zstd' (of chunks; sqlite3 has none), 'none', 'message' or 'file'.
    """
    parts = [recordings] if isinstance(recordings, ImuRecording) else list(recordings)
    path = Path(path)
    _check(parts, path, storage, compression)
    writer = Writer(path, version=9, storage_plugin=STORAGES[storage])
    if storage == 'mcap' or compression != 'zstd':
        writer.set_compression(COMPRESSIONS[compression], CompressionFormat.ZSTD)
    for key, value in _metadata(parts):
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
    if compression not in COMPRESSIONS:
        raise BagError(f'compression {compression!r} is none of {", ".join(COMPRESSIONS)}')
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
        if part.stamp[0] < 0 or part.stamp[-1] >= END_OF_STAMPS:
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
                f'{part.namespace}/{track.topic}', track.message_type, typestore=types
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
    """Cut all recordings at common times, into stretches of at most ROWS rows each."""
    at = [0] * len(parts)
    while True:
        open_parts = [k for k, part in enumerate(parts) if at[k] < len(part)]
        if not open_parts:
            return
        limit = min(int(parts[k].stamp[at[k] : at[k] + ROWS][-1]) for k in open_parts)
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
