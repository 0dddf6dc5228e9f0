# SPDX-License-Identifier: Apache-2.0
"""Whatever bytes are wrong, there is a recording or one clear line; never anything else."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest
from imu_recording.bags.messages import read_messages
from recording_samples import make_recording

from imu_recording import BagError, read_bag, write_bag

KINDS = [
    ('mcap', 'none'),
    ('mcap', 'zstd'),
    ('mcap', 'file'),
    ('mcap', 'message'),
    ('sqlite3', 'none'),
    ('sqlite3', 'message'),
]
CASES = 25


def flip(data: bytearray, rng: random.Random) -> None:
    reach = min(len(data), rng.choice([120, 5000, len(data)]))
    data[rng.randrange(reach)] = rng.randrange(256)


def overwrite(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data))
    length = rng.choice([1, 8, 100])
    data[at : at + length] = bytes([rng.choice([0, 255])]) * length


def lose_one(data: bytearray, rng: random.Random) -> None:
    del data[rng.randrange(len(data))]


def cut(data: bytearray, rng: random.Random) -> None:
    del data[rng.randrange(1, len(data)) :]


DAMAGES: list[Callable[[bytearray, random.Random], None]] = [flip, flip, overwrite, lose_one, cut]


@pytest.mark.parametrize(('storage', 'compression'), KINDS)
def test_damage_anywhere(tmp_path: Path, storage: str, compression: str) -> None:
    write_bag(make_recording(60), tmp_path / 'b', storage=storage, compression=compression)
    (file,) = (f for f in (tmp_path / 'b').iterdir() if f.name != 'metadata.yaml')
    whole = file.read_bytes()
    rng = random.Random(f'{storage} {compression}')  # noqa: S311 (repeatable damage)
    read = 0
    refusals: list[str] = []
    for _ in range(CASES):
        data = bytearray(whole)
        for _ in range(rng.choice([1, 1, 3])):
            rng.choice(DAMAGES)(data, rng)
        file.write_bytes(data)
        try:
            recording = read_bag(tmp_path / 'b')
        except BagError as error:
            refusals.append(str(error))
        else:
            assert len(recording)
            read += 1
    assert read
    assert refusals
    for refusal in refusals:
        assert str(tmp_path) in refusal
        assert '\n' not in refusal


def test_damaged_metadata(tmp_path: Path) -> None:
    """With its metadata.yaml in any state a whole file is read, or the metadata named."""
    recording = make_recording(20)
    write_bag(recording, tmp_path / 'b')
    file = tmp_path / 'b' / 'metadata.yaml'
    whole = file.read_bytes()
    rng = random.Random(1)  # noqa: S311 (repeatable damage)
    for _ in range(2 * CASES):
        data = bytearray(whole)
        rng.choice(DAMAGES)(data, rng)
        file.write_bytes(data)
        assert len(read_bag(tmp_path / 'b')) == 20
    for text in ('', '[]', 'rosbag2_bagfile_information: 3', 'a: 2001-99-99', '{', '\0'):
        file.write_text(text)
        assert len(read_bag(tmp_path / 'b')) == 20


def test_a_row_that_claims_more_than_memory_ends_the_reading(tmp_path: Path) -> None:
    write_bag(make_recording(600), tmp_path / 'b', storage='sqlite3')
    (file,) = (tmp_path / 'b').glob('*.db3')
    message = read_messages(tmp_path / 'b', ['/imu/temperature'])[301].data
    whole = file.read_bytes()
    at = whole.index(message) - 28  # an erased sector over the length of the record before it
    file.write_bytes(whole[:at] + b'\xff' * 30 + whole[at + 30 :])
    found = read_bag(tmp_path / 'b')
    assert 0 < len(found) < 600
    assert any('larger than memory' in note for note in found.notes)
