# SPDX-License-Identifier: Apache-2.0
"""Read the messages of a rosbag2 sqlite3 file in large blocks, also of one that was cut.

The rows of a whole file are decoded from its pages (`sqlite_pages`), several times faster than
sqlite hands them over; sqlite reads what that leaves: long messages, open and damaged files.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from imu_recording.bags.compression import decompress_message
from imu_recording.bags.decoding.topic_columns import Channel, MessageBlock, block_of
from imu_recording.bags.sqlite_pages import LARGEST_COLUMN_COUNT, MessagesTable, scan_pages
from imu_recording.recording import BagError

MAGIC = b'SQLite format 3\x00'
ROWS_PER_BLOCK = 8192
DAMAGE_ERRORS = (sqlite3.Error, UnicodeDecodeError, MemoryError)
"""Errors that sqlite3 raises on damaged files."""
LARGEST_TOPIC_ID = 1 << 20
"""A topic with a larger number is damage."""


def sqlite_channels(path: Path) -> dict[int, Channel]:
    """Return the topics of a file by their number; raise BagError where it is no bag."""
    with closing(_open(path)) as connection:
        try:
            topics: Any = connection.execute(
                'SELECT id, name, type, serialization_format FROM topics ORDER BY id'
            ).fetchall()
        except DAMAGE_ERRORS as error:
            raise BagError(f'{path}: not a rosbag2 sqlite3 file ({error})') from None
        try:
            offered = dict(connection.execute('SELECT id, offered_qos_profiles FROM topics'))
        except DAMAGE_ERRORS:
            offered = {}  # files written before ROS 2 Foxy carry none
        try:
            found: Any = connection.execute(
                'SELECT topic_type, encoded_message_definition FROM message_definitions'
            ).fetchall()
        except DAMAGE_ERRORS:
            found = []  # files written before ROS 2 Iron carry none
    definitions = {str(kind): str(text) for kind, text in found}
    return {
        key: Channel(
            topic=str(topic),
            message_type=str(kind),
            encoding=str(encoding),
            definition=definitions.get(str(kind), ''),
            qos=str(offered.get(key) or ''),
        )
        for key, topic, kind, encoding in topics
        if isinstance(key, int) and 0 <= key < LARGEST_TOPIC_ID
    }


def sqlite_metadata(path: Path) -> str:
    """Return the metadata the file carries as YAML, '' where it has none."""
    with closing(_open(path)) as connection:
        try:
            found: Any = connection.execute(
                'SELECT metadata FROM metadata ORDER BY id DESC LIMIT 1'
            ).fetchall()
        except DAMAGE_ERRORS:
            found = []  # files written before ROS 2 Iron, or not closed, carry none
    return str(found[0][0]) if found else ''


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
    table = np.full(max(slots) + 1, -1, np.int64)
    table[list(slots)] = list(slots.values())
    with closing(_open(path)) as connection:
        place = None if compressed else _messages_table(connection, problems)
        last = scan_pages(path, place, table, deliver) if place else -1
        damaged = 0
        for block in _blocks(connection, list(slots), last, problems):
            rows = [row for row in block if [*map(type, row)] == [int, int, int, bytes]]
            damaged += len(block) - len(rows)
            if not rows:
                continue
            _, topics, times, data = zip(*rows, strict=True)
            if compressed:
                data = tuple(decompress_message(message) for message in data)
            received = np.array(times, np.int64)
            deliver(block_of(data, received, table[np.array(topics, np.int64)]))
    if damaged:
        problems.append(f'{damaged} damaged rows left out')
    return problems


def _messages_table(connection: sqlite3.Connection, problems: list[str]) -> MessagesTable | None:
    """Return where the messages are, or None where the table is not rosbag2's own."""
    try:
        found: Any = connection.execute(
            "SELECT rootpage, sql FROM sqlite_master WHERE type = 'table' AND name = 'messages'"
        ).fetchall()
        columns: Any = connection.execute('PRAGMA table_info(messages)').fetchall()
    except DAMAGE_ERRORS as error:
        problems.append(f'its tables cannot be read: {error}')
        return None
    names = [column[1] for column in columns]
    key = [column[1] for column in columns if column[5]]
    if not found or key != ['id'] or 'WITHOUT' in found[0][1].upper():
        return None
    if len(names) > LARGEST_COLUMN_COUNT or not {'topic_id', 'timestamp', 'data'} <= set(names):
        return None
    places = [names.index(name) for name in ('topic_id', 'timestamp', 'data')]
    return MessagesTable(found[0][0], *places)


def _blocks(
    connection: sqlite3.Connection, topics: Sequence[int], last: int, problems: list[str]
) -> Iterator[list[Any]]:
    """Give the rows (id, topic_id, timestamp, data) behind row `last` in blocks, up to damage."""
    marks = ','.join('?' * len(topics))
    query = (
        'SELECT id, topic_id, timestamp, data FROM messages '  # noqa: S608
        f'WHERE id > ? AND topic_id IN ({marks}) ORDER BY id LIMIT ?'
    )
    limit, damage, done = ROWS_PER_BLOCK, '', False
    while not done:
        rows: list[Any] = []
        try:
            rows.extend(connection.execute(query, [last, *topics, limit]))
            done = len(rows) < limit
        except DAMAGE_ERRORS as error:  # rows keeps what came before
            done, damage = limit == 1, str(error) or 'a row that is larger than memory'
            limit = 1  # sqlite3 reads a row ahead: the last one before the damage comes alone
        sound = _in_order(rows, last)
        if sound < len(rows):  # a damaged tree may lead in a circle
            rows, done, damage = rows[:sound], True, 'rows are not in the order of their numbers'
        if rows:
            yield rows
            last = rows[-1][0]
    if damage:
        problems.append(f'reading stopped early: {damage}')


def _in_order(rows: Sequence[Any], last: int) -> int:
    """Return how many rows there are before the first whose number is not above all before it."""
    for count, row in enumerate(rows):
        if not isinstance(row[0], int) or row[0] <= last:
            return count
        last = row[0]
    return len(rows)


def _open(path: Path) -> sqlite3.Connection:
    """Open read only; a file left with a journal is read with it where that is allowed.

    A file that is shorter than its header says is refused by sqlite unless the schema is
    writable; what is left of it can then be read up to the cut.
    """
    for options, lenient in (('mode=ro', 0), ('mode=ro&immutable=1', 0), ('immutable=1', 1)):
        try:
            connection = sqlite3.connect(f'{path.resolve().as_uri()}?{options}', uri=True)
            connection.execute(f'PRAGMA writable_schema={lenient}')
            connection.execute('SELECT count(*) FROM sqlite_master').fetchall()
        except DAMAGE_ERRORS as error:
            reason = error
        else:
            return connection
    raise BagError(f'{path}: cannot be opened as a rosbag2 sqlite3 file ({reason})')
