# SPDX-License-Identifier: Apache-2.0
"""The streamed file is one that rosbags reads, indexed, and whole up to every flush."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from anyreader_columns import columns
from imu_recording.bags.mcap.writer import McapStream
from imu_recording.logging_contract import IMU
from recording_samples import START, TYPES, imu
from rosbags.highlevel import AnyReader

from imu_recording import read_bag

DEFINITION = TYPES.generate_msgdef(IMU, ros_version=2)[0]


def stream_pieces(n: int = 100, every: int = 30, compression: str = 'zstd') -> list[bytes]:
    """The pieces of a file with n Imu messages, flushed after every few."""
    stream = McapStream(compression=compression)
    pieces = [stream.begin(), stream.metadata('custom_data', {'device': 'dut7', 'run': '3'})]
    channel = stream.add_channel('/imu/data_raw', IMU, DEFINITION)
    for i in range(n):
        stamp = START + i * 10**7
        stream.add_message(channel, stamp, TYPES.serialize_cdr(imu(stamp, i), IMU))
        if i % every == every - 1:
            pieces.append(stream.flush())
    pieces.append(stream.end())
    assert stream.position == sum(map(len, pieces))
    return pieces


@pytest.mark.parametrize('compression', ['', 'zstd', 'lz4'])
def test_rosbags_reads_it_through_its_index(tmp_path: Path, compression: str) -> None:
    file = tmp_path / 'b.mcap'
    file.write_bytes(b''.join(stream_pieces(compression=compression)))
    recording = read_bag(file)
    wanted = columns(file, '/imu/data_raw', 'angular_velocity')
    assert len(recording) == 100
    assert np.array_equal(recording.angular_velocity, wanted['angular_velocity'])
    assert np.array_equal(recording.stamp, wanted['received'])
    assert (recording.device, recording.run) == ('dut7', '3')
    with AnyReader([file]) as reader:
        assert (reader.message_count, reader.duration) == (100, 99 * 10**7 + 1)
        window = list(reader.messages(start=START + 30 * 10**7, stop=START + 60 * 10**7))
    assert len(window) == 30


@pytest.mark.parametrize('compression', ['', 'zstd', 'lz4'])
def test_whole_up_to_every_flush_and_beyond(tmp_path: Path, compression: str) -> None:
    pieces = stream_pieces(compression=compression)
    file = tmp_path / 'b.mcap'
    for flushed in (1, 2, 3):
        start = b''.join(pieces[: 2 + flushed])
        for more in (0, 5, 60, 900, len(pieces[2 + flushed]) - 10):
            file.write_bytes(start + pieces[2 + flushed][:more])
            recording = read_bag(file)
            at_least = min(30 * flushed, 100)
            assert at_least <= len(recording) <= at_least + 30
            assert np.array_equal(recording.angular_velocity[:, 0], np.arange(len(recording)))
            assert 'b.mcap: was not closed: read as far as it goes' in recording.notes


def test_cut_uncompressed_chunk_gives_its_whole_messages(tmp_path: Path) -> None:
    pieces = stream_pieces(compression='')
    file = tmp_path / 'b.mcap'
    file.write_bytes(b''.join(pieces[:3]) + pieces[3][: len(pieces[3]) // 2])
    assert 40 <= len(read_bag(file)) < 60


def test_damaged_chunk_is_left_out_and_said(tmp_path: Path) -> None:
    for compression in ('', 'zstd', 'lz4'):
        pieces = stream_pieces(compression=compression)
        broken = bytearray(pieces[3])
        broken[100] ^= 0xFF
        file = tmp_path / 'b.mcap'
        file.write_bytes(b''.join([*pieces[:3], bytes(broken), *pieces[4:]]))
        recording = read_bag(file)
        assert len(recording) == 70
        assert any('is left out' in note for note in recording.notes)


def test_messages_outside_chunks(tmp_path: Path) -> None:
    """Files without chunks, cut anywhere, read as far as whole messages go."""
    stream = McapStream(compression='')
    start = stream.begin()
    channel = stream.add_channel('/imu/data_raw', IMU, DEFINITION)
    for i in range(50):
        stream.add_message(channel, START + i, TYPES.serialize_cdr(imu(START + i, i), IMU))
    chunk = stream.flush()
    (size,) = struct.unpack_from('<Q', chunk, 9 + 16)
    records = chunk[9 + 40 : 9 + 40 + size]
    file = tmp_path / 'b.mcap'
    for end, closed in ((stream.end(), True), (b'', False), (b'\0' * 64, False)):
        file.write_bytes(start + records + end)
        recording = read_bag(file)
        assert np.array_equal(recording.angular_velocity[:, 0], np.arange(50))
        assert any('not closed' in note for note in recording.notes) is not closed
    file.write_bytes((start + records)[:-100])
    assert len(read_bag(file)) == 49
    file.write_bytes(start + records + chunk + McapStream().end())
    assert any('50 samples with a repeated stamp' in note for note in read_bag(file).notes)


def test_same_input_same_bytes() -> None:
    assert stream_pieces() == stream_pieces()
