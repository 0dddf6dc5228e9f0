# SPDX-License-Identifier: Apache-2.0
"""Every checksum of an mcap file is looked at: of chunks, data, summary and attachments."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from imu_recording.bags.mcap.footer import checksum_faults, read_footer
from imu_recording.bags.mcap.reader import read_summary
from imu_recording.bags.mcap.writer import McapStream
from mcap.writer import CompressionType, Writer
from recording_samples import TYPES, imu, temperature

from imu_recording import read_bag

ATTACHED = bytes(range(256)) * 40_000  # more than is read at a time


@pytest.fixture
def written(tmp_path: Path) -> Path:
    """An mcap file of the reference library: loose messages, an attachment, all checksums."""
    path = tmp_path / 'a.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream, CompressionType.NONE, use_chunking=False, enable_data_crcs=True)
        writer.start(profile='ros2')
        channels = {}
        for topic, kind in (
            ('/imu/data_raw', 'sensor_msgs/msg/Imu'),
            ('/imu/temperature', 'sensor_msgs/msg/Temperature'),
        ):
            definition, _ = TYPES.generate_msgdef(kind)
            schema = writer.register_schema(kind, 'ros2msg', definition.encode())
            channels[topic] = (kind, writer.register_channel(topic, 'cdr', schema))
        for i in range(60):
            stamp = 10_000_000 * i
            if i == 30:
                writer.add_attachment(stamp, stamp, 'calibration.bin', 'bytes', ATTACHED)
            for topic, message in (
                ('/imu/data_raw', imu(stamp, float(i))),
                ('/imu/temperature', temperature(stamp, 20.0 + i)),
            ):
                kind, channel = channels[topic]
                data = TYPES.serialize_cdr(message, kind)
                writer.add_message(channel, stamp, bytes(data), stamp)
        writer.finish()
    return path


def flipped(path: Path, place: int) -> Path:
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)
    return path


def test_a_whole_file_has_no_fault_and_all_its_messages(written: Path) -> None:
    recording = read_bag(written)
    assert len(recording) == 60
    assert not [note for note in recording.notes if 'checksum' in note]


def test_a_bit_in_a_message_outside_chunks_is_said(written: Path) -> None:
    at = written.read_bytes().find(np.float64(20.0).tobytes())
    recording = read_bag(flipped(written, at))
    said = 'a.mcap: the checksum of its data is wrong'
    assert [note for note in recording.notes if note.startswith(said)]


def test_a_bit_in_an_attachment_is_said(written: Path) -> None:
    at = written.read_bytes().find(ATTACHED) + len(ATTACHED) - 7
    recording = read_bag(flipped(written, at))
    assert len(recording) == 60  # the messages behind it are there
    assert [n for n in recording.notes if 'attachment at byte' in n and 'checksum is wrong' in n]


def test_a_summary_with_a_wrong_checksum_is_not_used(written: Path) -> None:
    assert read_summary(written) is not None
    with written.open('rb') as stream:
        footer = read_footer(stream)
    assert footer is not None
    flipped(written, footer.summary_start + 40)
    assert read_summary(written) is None
    recording = read_bag(written)
    assert len(recording) == 60
    assert [note for note in recording.notes if 'checksum of its summary is wrong' in note]


def test_own_files_are_without_fault(tmp_path: Path) -> None:
    stream = McapStream()
    data = stream.begin()
    channel = stream.add_channel('/a', 'std_msgs/msg/String', 'string data\n')
    stream.add_message(channel, 5, b'\x00\x01\x00\x00\x02\x00\x00\x00a\x00')
    (tmp_path / 'a.mcap').write_bytes(data + stream.end())
    with (tmp_path / 'a.mcap').open('rb') as file:
        assert checksum_faults(file) == []
        footer = read_footer(file)
    assert footer is not None
    with flipped(tmp_path / 'a.mcap', footer.summary_start + 12).open('rb') as file:
        assert checksum_faults(file) == [
            'the checksum of its summary is wrong: the summary is not used'
        ]
