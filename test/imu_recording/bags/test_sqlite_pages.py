# SPDX-License-Identifier: Apache-2.0
"""Reading sqlite3 pages gives what sqlite gives, whatever the table looks like inside."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from imu_recording.bags import sqlite as sqlite_scan
from imu_recording.bags.decoding.topic_columns import MessageBlock
from imu_recording.bags.sqlite import scan_sqlite, sqlite_channels
from recording_samples import START, make_bag, standard_messages

from imu_recording import BagError, read_bag

SCHEMA = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
    serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
    timestamp INTEGER NOT NULL, data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
INSERT INTO topics VALUES (1, '/a', 'x', 'cdr', ''), (2, '/b', 'x', 'cdr', ''),
    (300, '/c', 'x', 'cdr', '');
"""

Rows = list[tuple[int, int, bytes]]


def make_file(path: Path, rows: Rows, page_size: int) -> sqlite3.Connection:
    connection = sqlite3.connect(path)
    connection.execute(f'PRAGMA page_size={page_size}')
    connection.executescript(SCHEMA)
    with connection:
        connection.executemany(
            'INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)', rows
        )
    return connection


def some_rows(n: int, longest: int) -> Rows:
    rng = np.random.default_rng(5)
    times = [0, -5, 127, 128, -40_000, 1 << 20, 1 << 40, START, 1, -(1 << 30)]
    return [
        (
            int(rng.choice([1, 2, 300])),
            times[i % len(times)] + i if i % 11 else i % 2,
            rng.bytes(int(rng.integers(0, longest))),
        )
        for i in range(n)
    ]


def scanned(path: Path, slots: dict[int, int]) -> Rows:
    found: Rows = []

    def deliver(block: MessageBlock) -> None:
        found.extend(
            (int(block.slot[i]), int(block.received[i]), block.bytes_of(i))
            for i in range(block.count)
        )

    assert scan_sqlite(path, slots, deliver) == []
    return found


@pytest.fixture
def through_sqlite(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Count the messages that sqlite itself had to read."""
    counted: list[int] = []
    blocks = sqlite_scan._blocks

    def counting(*arguments):
        for rows in blocks(*arguments):
            counted.append(len(rows))
            yield rows

    monkeypatch.setattr(sqlite_scan, '_blocks', counting)
    return counted


@pytest.mark.parametrize('page_size', [512, 4096, 65536])
def test_every_row_in_order(tmp_path: Path, page_size: int, through_sqlite: list[int]) -> None:
    path = tmp_path / 'a.db3'
    rows = some_rows(4000, 400)
    connection = make_file(path, rows, page_size)
    with connection:
        connection.execute('DELETE FROM messages WHERE id % 7 = 3 OR id BETWEEN 500 AND 900')
    connection.close()
    kept = [row for i, row in enumerate(rows, start=1) if not (i % 7 == 3 or 500 <= i <= 900)]
    slots = {1: 0, 300: 1}
    wanted = [(slots[t], time, data) for t, time, data in kept if t in slots]
    assert scanned(path, slots) == wanted
    assert sum(through_sqlite) == 0


def test_long_messages_are_left_to_sqlite(tmp_path: Path, through_sqlite: list[int]) -> None:
    path = tmp_path / 'a.db3'
    rows = some_rows(1000, 200)
    rows[600] = (2, START, b'x' * 100_000)
    make_file(path, rows, 1024).close()
    assert scanned(path, {1: 0}) == [(0, t, d) for k, t, d in rows if k == 1]
    assert sum(through_sqlite) == 0  # long messages of other topics do not matter
    slots = {1: 0, 2: 1}
    assert scanned(path, slots) == [(slots[k], t, d) for k, t, d in rows if k in slots]
    assert 0 < sum(through_sqlite) < 500


def test_a_file_that_is_still_written(tmp_path: Path, through_sqlite: list[int]) -> None:
    """With a write-ahead log beside it the file alone is not the whole."""
    path = tmp_path / 'a.db3'
    rows = some_rows(500, 100)
    connection = make_file(path, rows[:300], 4096)
    connection.execute('PRAGMA journal_mode=WAL')
    with connection:
        connection.executemany(
            'INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)', rows[300:]
        )
    assert scanned(path, {2: 0}) == [(0, t, d) for k, t, d in rows if k == 2]
    assert sum(through_sqlite) > 0
    connection.close()


def test_tables_that_are_not_plain(tmp_path: Path, through_sqlite: list[int]) -> None:
    path = tmp_path / 'a.db3'
    rows = [(1, 1.5, b'a time that is no integer'), (1, 2, 'text'), (1, 3, b'plain')]
    make_file(path, rows, 4096).close()
    blocks: list[MessageBlock] = []
    problems = scan_sqlite(path, {1: 0}, blocks.append)
    assert sum(through_sqlite) == 3
    assert [block.bytes_of(0) for block in blocks] == [b'plain']
    assert problems == ['2 damaged rows left out']


def test_topics_and_files_that_are_no_bag(tmp_path: Path) -> None:
    path = make_bag(tmp_path / 'b', standard_messages(3), storage='sqlite3') / 'b.db3'
    names = [channel.topic for channel in sqlite_channels(path).values()]
    assert names == ['/imu/temperature', '/imu/data_raw', '/imu/mag']
    sqlite3.connect(tmp_path / 'other.db3').execute('CREATE TABLE x(y)').close()
    with pytest.raises(BagError, match='not a rosbag2 sqlite3 file'):
        read_bag(tmp_path / 'other.db3')


def test_a_damaged_tree_that_leads_in_a_circle_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, size = tmp_path / 'a.db3', 512
    rows = some_rows(3000, 200)
    make_file(path, rows, size).close()
    data = bytearray(path.read_bytes())
    with sqlite3.connect(path) as connection:
        query = "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
        parent = (connection.execute(query).fetchone()[0] - 1) * size
    connection.close()

    def last_child(page: int) -> int:
        return (int.from_bytes(data[page + 8 : page + 12], 'big') - 1) * size

    while data[last_child(parent)] == 0x05:
        parent = last_child(parent)
    first = parent + 12  # the last leaf of the last interior page is now the first of them
    place = parent + int.from_bytes(data[first : first + 2], 'big')
    data[parent + 8 : parent + 12] = data[place : place + 4]
    path.write_bytes(data)
    monkeypatch.setattr(sqlite_scan, 'ROWS_PER_BLOCK', 20)
    found: list[int] = []

    def deliver(block: MessageBlock) -> None:
        found.append(block.count)
        assert sum(found) <= len(rows)

    said = scan_sqlite(path, {1: 0, 2: 1, 300: 2}, deliver)
    assert said == ['reading stopped early: rows are not in the order of their numbers']
    assert 0.9 * len(rows) < sum(found) < len(rows)
