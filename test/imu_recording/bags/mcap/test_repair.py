# SPDX-License-Identifier: Apache-2.0
"""A file cut anywhere is whole again for every reader, with all that could be read of it."""

from __future__ import annotations

from pathlib import Path

import pytest
from imu_recording.bags.mcap.repair import repair_mcap
from imu_recording.recorder.bag_recorder import BagRecorder
from mcap.reader import NonSeekingReader, SeekingReader
from recording_samples import TYPES, standard_messages
from rosbags.highlevel import AnyReader

from imu_recording import read_bag

METADATA = {'device': 'dut1'}
Message = tuple[str, int, bytes]


def recorded(folder: Path) -> tuple[bytes, list[Message]]:
    """Return a closed file of five chunks, and its messages."""
    recorder = BagRecorder(folder, metadata=METADATA, sync=False)
    messages = []
    for number, (topic, received, message) in enumerate(standard_messages(25)):
        data = TYPES.serialize_cdr(message, message.__msgtype__)
        recorder.record(topic, message.__msgtype__, data, received)
        messages.append((topic, received, bytes(data)))
        if number % 15 == 14:
            recorder.flush()
    recorder.close()
    return (folder / f'{folder.name}_0.mcap').read_bytes(), messages


def read_with_mcap(path: Path) -> list[Message]:
    """Return what the mcap library finds by the summary and, the same, record by record."""
    found = []
    for reader in (SeekingReader, NonSeekingReader):
        with path.open('rb') as stream:
            read = reader(stream, validate_crcs=True)
            found.append(
                [
                    (channel.topic, message.log_time, message.data)
                    for _, channel, message in read.iter_messages(log_time_order=False)
                ]
            )
    assert found[0] == found[1]
    return found[0]


def test_wherever_it_is_cut_all_readers_get_what_was_there(tmp_path: Path) -> None:
    whole, messages = recorded(tmp_path / 'whole')
    kept = []
    for cut in [*range(0, len(whole), 61), *range(len(whole) - 40, len(whole))]:
        path = tmp_path / f'{cut}.mcap'
        path.write_bytes(whole[:cut])
        assert repair_mcap(path, sync=False) is not None
        found = read_with_mcap(path)
        assert found == messages[: len(found)], cut
        kept.append(len(found))
        if found:
            with AnyReader([path]) as reader:
                assert reader.message_count == len(list(reader.messages())) == len(found)
        assert repair_mcap(path) is None  # nothing is missing any more
        path.unlink()
    assert kept == sorted(kept)
    assert kept[0] == 0
    assert kept[-1] == len(messages)
    assert len(set(kept)) > 5


def test_a_whole_file_stays_as_it_is(tmp_path: Path) -> None:
    whole, _ = recorded(tmp_path / 'run')
    path = tmp_path / 'run' / 'run_0.mcap'
    assert repair_mcap(path) is None
    assert path.read_bytes() == whole


def test_a_repair_that_was_killed_can_be_repeated(tmp_path: Path) -> None:
    whole, messages = recorded(tmp_path / 'run')
    path = tmp_path / 'cut.mcap'
    path.write_bytes(whole[: len(whole) * 2 // 3])
    before = repair_mcap(path)
    path.write_bytes(path.read_bytes()[:-30])
    assert repair_mcap(path) == before
    assert read_with_mcap(path) == messages[:before]


@pytest.mark.parametrize('keep', [0.3, 0.9])
def test_metadata_and_qos_survive(tmp_path: Path, keep: float) -> None:
    whole, _ = recorded(tmp_path / 'run')
    path = tmp_path / 'run' / 'run_0.mcap'
    path.write_bytes(whole[: int(keep * len(whole))])
    (tmp_path / 'run' / 'metadata.yaml').unlink()
    BagRecorder(tmp_path / 'run', metadata=METADATA)
    recording = read_bag(tmp_path / 'run')
    assert recording.device == 'dut1'
    assert not any('was not closed' in note for note in recording.notes)
    with AnyReader([tmp_path / 'run']) as reader:
        assert reader.message_count > len(recording) > 0
    with path.open('rb') as stream:
        (metadata,) = SeekingReader(stream).iter_metadata()
    assert metadata.metadata == METADATA
