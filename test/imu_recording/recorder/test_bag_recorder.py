# SPDX-License-Identifier: Apache-2.0
"""What was flushed survives a kill, a full disk and a restart."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from imu_recording.logging_contract import IMU
from imu_recording.recorder.bag_recorder import BagRecorder
from recording_samples import START, TYPES, imu, plain, standard_messages
from rosbags.highlevel import AnyReader

from imu_recording import BagError, read_bag

METADATA = {'device': 'dut1', 'run': '2', 'up_axis': '+z', 'profile': 'short_20min'}


def feed(recorder: BagRecorder, messages: list[tuple[str, int, Any]]) -> None:
    for topic, received, message in messages:
        kind = message.__msgtype__
        recorder.record(topic, kind, TYPES.serialize_cdr(message, kind), received)


def phase(text: str, received: int) -> tuple[str, int, Any]:
    return '/chamber/phase', received, plain('String', text)


def test_one_file_per_phase_readable_by_all(tmp_path: Path) -> None:
    recorder = BagRecorder(tmp_path / 'run', metadata=METADATA)
    messages = standard_messages(30)
    feed(recorder, [phase('precondition 0', START), *messages[:30]])
    feed(recorder, [phase('ramp_up 1', messages[30][1]), *messages[30:60]])
    feed(recorder, [phase('ramp_up 2', messages[60][1]), *messages[60:]])
    recorder.close()
    names = sorted(file.name for file in (tmp_path / 'run').iterdir())
    assert names == ['metadata.yaml', 'run_0.mcap', 'run_1.mcap']
    recording = read_bag(tmp_path / 'run')
    assert np.array_equal(recording.angular_velocity[:, 0], np.arange(30))
    assert recording.phase is not None
    assert recording.phase.tolist() == [0] * 10 + [3] * 20
    assert recording.cycle is not None
    assert recording.cycle[-1] == 2
    assert (recording.device, recording.run, recording.up_axis) == ('dut1', '2', '+z')
    assert not any('not closed' in note for note in recording.notes)
    with AnyReader([tmp_path / 'run']) as reader:
        assert reader.message_count == 93
        assert len(list(reader.messages())) == 93


def test_split_by_size(tmp_path: Path) -> None:
    recorder = BagRecorder(tmp_path / 'run', split_bytes=8000, compression='')
    feed(recorder, standard_messages(100))
    recorder.close()
    files = sorted((tmp_path / 'run').glob('*.mcap'))
    assert len(files) > 5
    assert len(read_bag(tmp_path / 'run')) == 100


def test_flushed_is_on_disk_and_metadata_names_the_file(tmp_path: Path) -> None:
    recorder = BagRecorder(tmp_path / 'run', metadata=METADATA)
    messages = standard_messages(30)
    feed(recorder, messages[:45])
    recorder.flush()
    feed(recorder, messages[45:])
    recording = read_bag(tmp_path / 'run')
    assert len(recording) == 15
    assert recording.device == 'dut1'
    assert any('was not closed' in note for note in recording.notes)
    content = yaml.safe_load((tmp_path / 'run' / 'metadata.yaml').read_text())
    information = content['rosbag2_bagfile_information']
    assert information['relative_file_paths'] == ['run_0.mcap']
    assert information['custom_data'] == METADATA


def test_an_interrupted_recording_is_continued(tmp_path: Path) -> None:
    messages = standard_messages(30)
    first = BagRecorder(tmp_path / 'run', metadata=METADATA)
    feed(first, messages[:45])
    first.flush()
    with pytest.raises(BagError, match=r'run_0\.mcap: another recorder is writing it'):
        BagRecorder(tmp_path / 'run')
    assert first._open is not None
    os.close(first._open.descriptor)  # as a kill does
    second = BagRecorder(tmp_path / 'run', metadata=METADATA)
    assert list(second.repaired.values()) == [45]
    second.close()
    second = BagRecorder(tmp_path / 'run', metadata={'run': '3'})
    assert second.metadata == METADATA | {'run': '3'}
    second = BagRecorder(tmp_path / 'run', metadata=METADATA)
    feed(second, messages[45:])
    second.close()
    assert len(read_bag(tmp_path / 'run')) == 30
    content = yaml.safe_load((tmp_path / 'run' / 'metadata.yaml').read_text())
    information = content['rosbag2_bagfile_information']
    assert information['message_count'] == 90
    assert information['duration']['nanoseconds'] == 29 * 10_000_000


def test_a_full_disk_leaves_everything_before_it(tmp_path: Path) -> None:
    recorder = BagRecorder(tmp_path / 'run', compression='', sync=False)
    messages = standard_messages(200)
    flushed = 0
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, limits[1]))
    try:
        with pytest.raises(BagError, match=r'run_0\.mcap: cannot be written'):  # noqa: PT012
            for at in range(0, len(messages), 30):
                feed(recorder, messages[at : at + 30])
                recorder.flush()
                flushed += 10
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert flushed > 20
    assert len(read_bag(tmp_path / 'run')) == flushed


CHILD = """
import sys
from imu_recording.recorder.bag_recorder import BagRecorder
data = sys.stdin.buffer.read()
recorder = BagRecorder(sys.argv[1])
for i in range(10_000_000):
    recorder.record('/imu/data_raw', 'sensor_msgs/msg/Imu', data, i + 1)
    if i % 100 == 99:
        recorder.flush()
        print(i + 1, flush=True)
"""


def test_kill_9_loses_nothing_that_was_flushed(tmp_path: Path) -> None:
    child = subprocess.Popen(
        [sys.executable, '-c', CHILD, str(tmp_path / 'run')],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert child.stdin is not None
    assert child.stdout is not None
    child.stdin.write(bytes(TYPES.serialize_cdr(imu(START), IMU)))
    child.stdin.close()
    flushed = [int(child.stdout.readline()) for _ in range(20)][-1]
    os.kill(child.pid, signal.SIGKILL)
    flushed = max([flushed, *map(int, child.stdout.read().split())])
    child.wait()
    with pytest.raises(AssertionError):  # rosbags needs the footer
        count_messages(tmp_path / 'run')
    recording = read_bag(tmp_path / 'run', remap={})
    assert len(recording) == 1  # one stamp, repeated
    repeated = next(note for note in recording.notes if 'repeated stamp' in note)
    assert int(repeated.split()[1]) + 1 >= flushed
    again = BagRecorder(tmp_path / 'run')
    assert list(again.repaired.values()) == [count_messages(tmp_path / 'run')]
    assert count_messages(tmp_path / 'run') >= flushed


def count_messages(path: Path) -> int:
    from rosbags.highlevel import AnyReaderError

    try:
        with AnyReader([path]) as reader:
            return int(reader.message_count)
    except AnyReaderError as error:
        raise AssertionError(str(error)) from None


def test_an_empty_file_of_a_killed_recorder_does_not_stop_the_next(tmp_path: Path) -> None:
    (tmp_path / 'run').mkdir()
    (tmp_path / 'run' / 'run_0.mcap').touch()
    recorder = BagRecorder(tmp_path / 'run')
    feed(recorder, standard_messages(5))
    recorder.close()
    assert len(read_bag(tmp_path / 'run')) == 5


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / 'file').touch()
    with pytest.raises(BagError, match='file/run: cannot be written'):
        BagRecorder(tmp_path / 'file' / 'run')


def test_a_disk_that_does_not_take_the_data_is_an_error(tmp_path: Path, monkeypatch: Any) -> None:
    recorder = BagRecorder(tmp_path / 'run')
    messages = standard_messages(30)
    feed(recorder, messages[:45])
    recorder.flush()

    def fail(_: int) -> None:
        raise OSError(5, 'Input/output error')

    feed(recorder, messages[45:])
    monkeypatch.setattr('imu_recording.recorder.bag_recorder.os.fsync', fail)
    with pytest.raises(BagError, match=r'run_0\.mcap: not on disk \(Input'):
        recorder.flush()
    monkeypatch.undo()
    recorder.close()  # there is no file left to close
    assert len(read_bag(tmp_path / 'run')) >= 15


def test_what_the_recorder_lost_stands_in_one_note(tmp_path: Path) -> None:
    recorder = BagRecorder(tmp_path / 'run', metadata=METADATA)
    feed(recorder, standard_messages(30))
    recorder.note('messages_lost', '/imu/data_raw 12, /imu/mag 3')
    recorder.close()
    notes = read_bag(tmp_path / 'run').notes
    told = 'the recorder lost 15 messages: 12 on /imu/data_raw, 3 on /imu/mag'
    assert [note for note in notes if 'lost' in note] == [told]
