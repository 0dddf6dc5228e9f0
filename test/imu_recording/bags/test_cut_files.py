# SPDX-License-Identifier: Apache-2.0
"""Recordings that were never closed: what is there is read, and said to be incomplete."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from imu_recording.bags import sqlite as sqlite_scan
from recording_samples import (
    arrays,
    assert_same,
    make_bag,
    make_recording,
    standard_messages,
)

from imu_recording import BagError, ImuRecording, read_bag, write_bag


def assert_beginning_of(part: ImuRecording, whole: ImuRecording) -> None:
    """Every row that was read is the whole's."""
    for name, column in arrays(part).items():
        if name in ('stamp', 'angular_velocity', 'linear_acceleration'):
            assert np.array_equal(column, arrays(whole)[name][: len(part)]), name


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_without_metadata(tmp_path: Path, storage: str) -> None:
    recording = make_recording()
    write_bag(recording, tmp_path / 'b', storage=storage)
    (tmp_path / 'b' / 'metadata.yaml').unlink()
    back = read_bag(tmp_path / 'b')
    assert 'metadata.yaml is missing: the recording was not closed' in back.notes
    assert_same(recording, back)  # the file carries a copy
    (tmp_path / 'b' / 'metadata.yaml').write_text('rosbag2_bagfile_information: [')
    assert any('cannot be read' in note for note in read_bag(tmp_path / 'b').notes)


def test_a_file_by_itself(tmp_path: Path) -> None:
    recording = make_recording()
    write_bag(recording, tmp_path / 'b')
    assert_same(recording, read_bag(tmp_path / 'b' / 'b.mcap'))
    assert_same(recording, read_bag(tmp_path / 'b' / 'metadata.yaml'))
    write_bag(recording, tmp_path / 'm', compression='message')
    assert_same(recording, read_bag(tmp_path / 'm' / 'm.mcap'))
    (tmp_path / 'm' / 'metadata.yaml').unlink()
    alone = read_bag(tmp_path / 'm')
    assert np.array_equal(alone.angular_velocity, recording.angular_velocity)
    assert np.array_equal(alone.phase, recording.phase)


@pytest.mark.parametrize('compression', ['zstd', 'none', 'message', 'file'])
def test_cut_mcap(tmp_path: Path, compression: str) -> None:
    recording = make_recording(1500, step_ns=10_000_000)
    write_bag(recording, tmp_path / 'b', compression=compression)
    (file,) = (tmp_path / 'b').glob('b.mcap*')
    whole = file.read_bytes()
    lengths = []
    for share in (0.3, 0.6, 0.95):
        file.write_bytes(whole[: int(share * len(whole))])
        part = read_bag(tmp_path / 'b')
        assert any('was not closed' in note for note in part.notes)
        assert_beginning_of(part, recording)
        lengths.append(len(part))
    assert 0 < lengths[0] < lengths[1] < lengths[2] <= 1500
    file.write_bytes(whole[:40])
    with pytest.raises(BagError):
        read_bag(tmp_path / 'b')


def test_cut_sqlite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sqlite_scan, 'ROWS_PER_BLOCK', 64)
    recording = make_recording(500)
    write_bag(recording, tmp_path / 'b', storage='sqlite3')
    assert_same(recording, read_bag(tmp_path / 'b'))
    file = tmp_path / 'b' / 'b.db3'
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2 // 4096 * 4096])
    part = read_bag(tmp_path / 'b')
    assert 0 < len(part) < 500
    assert any('reading stopped early' in note for note in part.notes)
    assert_beginning_of(part, recording)


def test_a_file_metadata_does_not_know(tmp_path: Path) -> None:
    """A recorder that died after starting its next file."""
    whole = standard_messages(40)
    bag = make_bag(tmp_path / 'b', whole[:60])
    make_bag(tmp_path / 'c', whole[60:])
    (tmp_path / 'c' / 'c.mcap').rename(bag / 'b_1.mcap')
    (bag / 'b_2.mcap').touch()
    recording = read_bag(bag)
    assert len(recording) == 40
    assert 'b_1.mcap, b_2.mcap is not in metadata.yaml: the recording was not closed' in (
        recording.notes
    )
    assert 'b_2.mcap is empty' in recording.notes
    (bag / 'b.mcap').unlink()
    assert 'b.mcap named in metadata.yaml is missing' in read_bag(bag).notes
