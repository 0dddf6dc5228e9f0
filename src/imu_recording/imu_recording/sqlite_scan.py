# SPDX-License-Identifier: Apache-2.0
"""Read the messages of a rosbag2 sqlite3 file in large blocks."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np

from imu_recording.bag_error import BagError
from imu_recording.decompress import decompress_message
from imu_recording.mcap_scan import Channel
from imu_recording.topic_columns import MessageBlock

MAGIC = b'SQLite format 3\x00'
ROWS = 8192


def sqlite_channels(path: Path) -> dict[int, Channel]:
    """Return the topics of a file by their number; raise BagError where it is no bag."""
    with closing(_open(path)) as connection:
        try:
            topics = connection.execute(
                'SELECT id, name, type, serialization_format FROM topics ORDER BY id'
            ).fetchall()
        except sqlite3.DatabaseError as error:
            raise BagError(f'{path}: not a rosbag2 sqlite3 file ({error})') from None
        try:
            definitions = dict(
                connection.execute(
                    'SELECT topic_type, encoded_message_definition FROM message_definitions'
                ).fetchall()
            )
        except sqlite3.DatabaseError:
            definitions = {}  # files written before ROS 2 Iron carry none
    return {
        key: Channel(topic, kind, encoding, definitions.get(kind, ''))
        for key, topic, kind, encoding in topics
    }


def scan_sqlite(
    path: Path,
    slots: dict[int, int],
    deliver: Callable[[MessageBlock], None],
    *,
    compressed: bool = False,
) -> list[str]:
    """Deliver the messages of the topics in `slots` (number → slot); return what went wrong."""
    problems: list[str] = []
    if not slots:
        return problems
    marks = ','.join('?' * len(slots))
    query = f'SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks})'  # noqa: S608
    table = np.full(max(slots) + 1, -1, np.int64)
    table[list(slots)] = list(slots.values())
    damaged = 0
    with closing(_open(path)) as connection:
        cursor = connection.execute(query, list(slots))
        for rows in _blocks(cursor, problems):
            topics, times, data = zip(*rows, strict=True)
            if compressed:
                data, lost = _decompressed(data)
                damaged += lost
            length = np.fromiter(map(len, data), np.int64, len(data))
            offset = np.zeros(len(data), np.int64)
            np.cumsum(length[:-1], out=offset[1:])
            buffer = np.frombuffer(b''.join(data), np.uint8)
            slot = table[np.array(topics, np.int64)]
            received = np.array(times, np.int64)
            deliver(MessageBlock(buffer, offset, length, received, slot, len(data)))
    if damaged:
        problems.append(f'{damaged} messages do not decompress and are left out')
    return problems


def _blocks(cursor: sqlite3.Cursor, problems: list[str]) -> Iterator[list[tuple[int, int, bytes]]]:
    while True:
        try:
            rows = cursor.fetchmany(ROWS)
        except sqlite3.DatabaseError as error:
            problems.append(f'reading stopped early: {error}')
            return
        if not rows:
            return
        yield rows


def _decompressed(data: tuple[bytes, ...]) -> tuple[tuple[bytes, ...], int]:
    done = []
    lost = 0
    for message in data:
        try:
            done.append(decompress_message(message))
        except ValueError:
            done.append(b'')
            lost += 1
    return tuple(done), lost


def _open(path: Path) -> sqlite3.Connection:
    """Open read only; a file that died with a journal is read with it where that is allowed."""
    for options in ('mode=ro', 'mode=ro&immutable=1'):
        connection = sqlite3.connect(f'{path.resolve().as_uri()}?{options}', uri=True)
        try:
            connection.execute('SELECT count(*) FROM sqlite_master').fetchone()
        except sqlite3.DatabaseError as error:
            connection.close()
            reason = error
        else:
            return connection
    raise BagError(f'{path}: cannot be opened as a rosbag2 sqlite3 file ({reason})')
