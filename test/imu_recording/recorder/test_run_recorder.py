# SPDX-License-Identifier: Apache-2.0
"""A bag for each run that a chamber announces, with what its profile wants recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from imu_recording.recorder.plan import RecorderConfig, recording_plan
from imu_recording.recorder.run_announcement import RunAnnouncement, parse_announcement
from imu_recording.recorder.run_recorder import RunRecorder
from recording_samples import START, TYPES, plain, standard_messages

from imu_recording import BagError, RecordingError, read_bag

LATCHED = [{'durability': 'transient_local'}]
CAMPAIGN = RunAnnouncement(directory='today', runs=3, profile='three', profile_sha256='ab12')


def announced(axis: str, **changes: Any) -> RunAnnouncement:
    return RunAnnouncement(
        **{**CAMPAIGN.__dict__, 'run': axis.lstrip('+'), 'up_axis': axis, **changes}
    )


def feed(recorder: RunRecorder, messages: list[tuple[str, int, Any]]) -> None:
    for topic, received, message in messages:
        kind = message.__msgtype__
        latched = LATCHED if topic == '/chamber/phase' else ()
        recorder.record(topic, kind, TYPES.serialize_cdr(message, kind), received, latched)


def phase(text: str, received: int) -> tuple[str, int, Any]:
    return '/chamber/phase', received, plain('String', text)


def custom_data(folder: Path) -> dict[str, str]:
    content = yaml.safe_load((folder / 'metadata.yaml').read_text())
    return content['rosbag2_bagfile_information']['custom_data']


def test_each_orientation_gets_a_bag_of_its_own_and_turning_none(tmp_path: Path) -> None:
    recorder = RunRecorder(RecorderConfig(device='dut1'), tmp_path / 'rec')
    messages = standard_messages(90)
    recorder.follow(CAMPAIGN, START)
    feed(recorder, messages[:30])  # before the start
    for axis, part in (('+x', messages[30:90]), ('-z', messages[120:210])):
        recorder.follow(announced(axis), part[0][1])
        feed(recorder, [phase('precondition 0', part[0][1]), *part])
        recorder.flush()
        recorder.follow(CAMPAIGN, part[-1][1])
        feed(recorder, messages[210:240])  # while the devices are turned
    recorder.close()
    assert sorted(path.name for path in (tmp_path / 'rec').iterdir()) == ['-z', 'x']
    for name, axis, rows in (('x', '+x', range(10, 30)), ('-z', '-z', range(40, 70))):
        recording = read_bag(tmp_path / 'rec' / name)
        assert recording.up_axis == axis
        assert np.array_equal(recording.angular_velocity[:, 0], rows)
        assert custom_data(tmp_path / 'rec' / name) == {
            'device': 'dut1', 'run': name, 'up_axis': axis, 'profile': 'three',
            'profile_sha256': 'ab12',
        }  # fmt: skip


def test_every_bag_begins_with_what_was_latched_before_it(tmp_path: Path) -> None:
    recorder = RunRecorder(RecorderConfig(), tmp_path / 'rec')
    recorder.follow(CAMPAIGN, START)
    messages = standard_messages(20)
    feed(recorder, [phase('ramp_up 2', START)])  # overtook the announcement on its way
    recorder.follow(announced('+y'), messages[0][1])
    feed(recorder, messages)
    recorder.close()
    recording = read_bag(tmp_path / 'rec' / 'y')
    assert recording.phase is not None
    assert set(recording.phase) == {3}


def test_what_came_before_the_first_announcement_goes_where_it_says(tmp_path: Path) -> None:
    recorder = RunRecorder(RecorderConfig(), tmp_path / 'rec')
    messages = standard_messages(30)
    feed(recorder, messages[:30])
    recorder.flush(expecting=True)
    assert not (tmp_path / 'rec').exists()
    recorder.follow(announced('+y'), messages[30][1])
    feed(recorder, messages[30:])
    recorder.close()
    assert len(read_bag(tmp_path / 'rec' / 'y')) == 30


def test_a_recorder_that_was_there_first_keeps_its_bag_apart(tmp_path: Path) -> None:
    recorder = RunRecorder(RecorderConfig(), tmp_path / 'rec')
    messages = standard_messages(30)
    feed(recorder, messages[:30])
    recorder.flush()
    recorder.follow(announced('+x'), messages[30][1])
    feed(recorder, messages[30:])
    recorder.close()
    assert len(read_bag(tmp_path / 'rec')) == 10
    assert len(read_bag(tmp_path / 'rec_x')) == 20


def test_a_single_run_stays_in_one_bag_and_gets_its_metadata(tmp_path: Path) -> None:
    recorder = RunRecorder(RecorderConfig(), tmp_path / 'rec')
    messages = standard_messages(30)
    feed(recorder, messages[:30])
    recorder.flush()
    single = announced('+y', runs=1)
    recorder.follow(single, messages[30][1])
    feed(recorder, messages[30:])
    recorder.follow(single, messages[-1][1])
    recorder.close()
    assert len(read_bag(tmp_path / 'rec')) == 30
    assert custom_data(tmp_path / 'rec')['up_axis'] == '+y'
    assert len(list((tmp_path / 'rec').glob('*.mcap'))) == 2


def test_another_run_of_the_profile_goes_to_another_folder(tmp_path: Path) -> None:
    recorder = RunRecorder(RecorderConfig(), tmp_path / 'rec')
    messages = standard_messages(30)
    for number, directory in enumerate(('first', 'second', 'third')):
        recorder.follow(announced('+y', runs=1, directory=directory), START)
        feed(recorder, messages[30 * number : 30 * (number + 1)])
    recorder.close()
    assert [len(read_bag(tmp_path / name)) for name in ('rec', 'rec_2', 'rec_3')] == [10] * 3


def test_the_profile_says_what_is_recorded_and_when_a_file_begins(tmp_path: Path) -> None:
    wishes = {'topics': ('imu/*',), 'split': 'phase', 'runs': 1}
    recorder = RunRecorder(RecorderConfig(), tmp_path / 'rec')
    recorder.follow(announced('+x', **wishes), START)
    assert not recorder.needs('/chamber/heater')
    assert recorder.needs('/chamber/phase')  # tells when a file begins
    messages = standard_messages(20)
    feed(recorder, [phase('precondition 0', START), *messages[:30]])
    feed(recorder, [phase('ramp_up 1', messages[30][1]), *messages[30:]])
    recorder.close()
    recording = read_bag(tmp_path / 'rec')
    assert len(recording) == 20
    assert recording.phase is None
    assert len(list((tmp_path / 'rec').glob('*.mcap'))) == 2


def test_what_the_recorder_is_told_itself_counts_more(tmp_path: Path) -> None:
    own = RecorderConfig(topics=['imu/mag'], split='none', run='7', up_axis='-y', profile='mine')
    plan = recording_plan(own, tmp_path, announced('+x', runs=1, topics=('a',), split='phase'))
    assert (plan.topics, plan.at_phase) == (('imu/mag',), False)
    assert plan.metadata == {'run': '7', 'up_axis': '-y', 'profile': 'mine'}
    plan = recording_plan(own, tmp_path, announced('+x', split='size'))
    assert plan.metadata['up_axis'] == '+x'  # of several runs only the chamber knows which it is
    assert recording_plan(RecorderConfig(), tmp_path, announced('+x', split='size')).split_bytes


@pytest.mark.parametrize('text', ['', 'x', '[]', '{"runs": "many"}', '{"topics": 3}'])
def test_what_is_no_announcement_is_refused(text: str) -> None:
    with pytest.raises(RecordingError, match='chamber/run'):
        parse_announcement(text)


def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_lost() -> None:
    with pytest.raises(BagError, match='cannot be written'):
        RunRecorder(RecorderConfig(), Path('/proc/1/nowhere'))
