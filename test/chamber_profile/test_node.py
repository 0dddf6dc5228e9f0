# SPDX-License-Identifier: Apache-2.0
"""The node in-process, on a clock by hand: what it publishes, refuses, watches over, resumes."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from chamber_profile.run.journal import read_journal
from chamber_profile.run.values import ABORTED, DONE, RUN, SAFE
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from imu_recording.recorder.run_announcement import parse_announcement
from node_harness import NodeHarness
from rclpy.lifecycle import TransitionCallbackReturn
from sensor_msgs.msg import Temperature


@pytest.fixture
def make(ros, tmp_path):
    harnesses = []

    def build(directory: Path = tmp_path / 'run', **parameters) -> NodeHarness:
        harnesses.append(NodeHarness(directory, **parameters))
        return harnesses[-1]

    yield build
    for harness in harnesses:
        harness.node.destroy_node()


def test_activation_moves_nothing(make) -> None:
    harness = make()
    for _ in range(100):
        harness.step()
    assert harness.mode == 'IDLE'
    assert not harness.node.snapshot.reading.running
    assert not harness.node.run.directory.exists()


def test_a_run_by_services_publishes_all_it_knows_and_ends_done(make) -> None:
    harness = make()
    harness.step()
    assert harness.call('start').success
    harness.until(lambda: harness.mode == RUN)
    refused = harness.call('start')
    assert not refused.success
    assert 'RUN' in refused.message
    harness.until(lambda: harness.mode == DONE)
    assert harness.node.exit_code is None  # it was not asked to exit
    assert {f'chamber/{name}' for name in (
        'setpoint', 'temperature', 'temperature_2', 'device_temperature', 'humidity', 'heater',
        'compressor', 'fan', 'phase',
    )} <= harness.topics()  # fmt: skip
    phases = [message.data for topic, message in harness.sent if topic == 'chamber/phase']
    assert phases == [
        'precondition 0', 'ramp_down 1', 'dwell_cold 1', 'ramp_up 1', 'dwell_hot 1',
        'ramp_down 1', 'dwell_reference 1', 'final 0',
    ]  # fmt: skip
    setpoints = [m.temperature for topic, m in harness.sent if topic == 'chamber/setpoint']
    assert min(setpoints) == 15.0
    assert max(setpoints) == 30.0


@pytest.mark.parametrize(('end', 'code'), [('', 0), ('abort', 1)])
def test_with_start_the_process_ends_with_the_run(make, end: str, code: int) -> None:
    harness = make(start=True)
    harness.until(lambda: harness.mode == RUN)
    if end:
        assert harness.call(end).success
    harness.until(lambda: harness.node.exit_code is not None)
    assert harness.node.exit_code == code


def test_a_dead_imu_ends_in_the_safe_state_after_ten_seconds(make) -> None:
    harness = make(start=True)
    harness.until(lambda: harness.node.snapshot.step.id == 'heat')
    harness.imu = False
    for _ in range(9):
        harness.step()
        assert harness.mode == RUN
    harness.until(lambda: harness.mode == SAFE, 3)
    assert 'IMU' in harness.node.snapshot.progress.reason
    level, line, _ = harness.node.diagnostics()
    assert level == 2
    assert 'IMU' in line


def test_an_imu_is_not_missed_where_none_is_required(make) -> None:
    harness = make(start=True, require_imu=False)
    harness.until(lambda: harness.mode == DONE)
    assert 'imu/temperature' not in harness.node.inputs


def test_a_recorder_that_fails_ends_the_run_safely(make) -> None:
    harness = make(start=True)
    harness.until(lambda: harness.node.snapshot.step.id == 'heat')
    status = DiagnosticStatus(level=bytes([2]), name='recorder', message='disk full')
    harness.node.inputs['/diagnostics'](DiagnosticArray(status=[status]))
    harness.step()
    assert harness.mode == SAFE
    assert 'disk full' in harness.node.snapshot.progress.reason


def test_a_reference_logger_takes_the_place_of_the_chambers_sensor(make) -> None:
    harness = make(start=True, publish_temperature=False)
    logger = harness.node.inputs

    def read(air: float) -> None:
        logger['chamber/temperature'](Temperature(temperature=air))
        logger['chamber/device_temperature'](Temperature(temperature=air + 1.0))

    for _ in range(50):
        read(22.0)
        harness.step()
    assert harness.mode == RUN
    assert harness.node.run.conductor.sequencer.progress.setpoint <= 22.0
    temperatures = {topic for topic in harness.topics() if 'temperature' in topic}
    assert not temperatures
    assert 'chamber/setpoint' in harness.topics()
    for _ in range(12):  # the logger falls silent
        harness.step()
    assert harness.mode == SAFE
    assert 'reference logger' in harness.node.snapshot.progress.reason


def test_a_run_is_resumed_from_its_directory_and_a_finished_one_refused(make, tmp_path) -> None:
    first = make(start=True)
    first.until(lambda: first.node.snapshot.step.id == 'hot')
    first.node.run.conductor.close()
    again = make(profile='')
    again.step()
    assert again.mode == 'IDLE'
    assert again.node.snapshot.step.id == 'hot'
    assert again.call('start').success
    again.until(lambda: again.mode == DONE)
    assert again.node.snapshot.progress.interruptions == 1
    events = [entry['event'] for entry in read_journal(tmp_path / 'run')]
    assert events.count('interrupted') == 1
    assert not make(profile='').started


def test_an_accelerated_clock_needs_a_chamber_that_says_it_is_emulated(make) -> None:
    harness = make(time_scale=60.0, start=True)
    harness.node.run.conductor.link.chamber.emulated = False
    harness.step()
    assert harness.node.exit_code == 2
    assert not harness.node.run.directory.exists()


def test_a_run_under_way_forbids_deactivation(make) -> None:
    harness = make(start=True)
    harness.until(lambda: harness.mode == RUN)
    state = SimpleNamespace(label='active')
    assert harness.node.on_deactivate(state) == TransitionCallbackReturn.FAILURE
    harness.node.stop_at_once()
    assert harness.node.run.conductor.sequencer.progress.mode == ABORTED
    assert not harness.node.run.conductor.link.chamber.running
    assert harness.node.trigger_deactivate() == TransitionCallbackReturn.SUCCESS


@pytest.mark.parametrize(
    'parameters',
    [
        {'profile': ''},
        {'profile': 'coffee'},
        {'chamber': 'coffee+tcp://localhost:1'},
        {'orientation': 'w'},
        {'run_directory': '/proc/nowhere', 'profile': ''},
    ],
)
def test_parameters_that_make_no_run_are_refused(make, parameters) -> None:
    directory = Path(parameters.pop('run_directory', 'nowhere'))
    harness = make(directory, **parameters)
    assert not harness.started
    assert harness.node.refused


def test_the_orientation_reaches_the_journal(make, tmp_path) -> None:
    harness = make(start=True, orientation='-z')
    harness.until(lambda: harness.mode == RUN)
    entries = read_journal(tmp_path / 'run')
    assert {entry['orientation'] for entry in entries if 'orientation' in entry} == {'-z'}


CAMPAIGN = """\
schema: 1
name: two
orientations: [x, -z]
limits: {air_min_c: 10, air_max_c: 35, rate_max_c_per_min: 3}
record: {topics: ['imu/*'], split: size}
steps:
  - {id: precondition, kind: precondition, target_c: 22, rate_c_per_min: 3, dwell_s: 60}
"""


def runs_said(harness: NodeHarness) -> list[str]:
    announcements = [
        parse_announcement(m.data) for topic, m in harness.sent if topic == 'chamber/run'
    ]
    assert {(n.profile, n.runs, n.split, n.topics) for n in announcements} == {
        ('two', 2, 'size', ('imu/*',))
    }
    assert all(n.run == n.up_axis.lstrip('+') for n in announcements)
    return [announcement.up_axis for announcement in announcements]


def test_each_orientation_is_announced_and_between_them_a_hand_is_waited_for(
    make, tmp_path
) -> None:
    profile = tmp_path / 'two.yaml'
    profile.write_text(CAMPAIGN)
    harness = make(profile=str(profile), start=True)
    assert runs_said(harness) == ['']
    harness.until(lambda: harness.node.snapshot.prompt)
    assert '-z points up' in harness.node.snapshot.prompt
    assert runs_said(harness) == ['', '+x', '']
    for _ in range(600):
        harness.step()
    assert harness.node.snapshot.prompt
    assert not harness.node.snapshot.reading.running
    assert harness.call('confirm').success
    harness.until(lambda: harness.node.exit_code is not None)
    assert harness.node.exit_code == 0
    assert runs_said(harness) == ['', '+x', '', '-z', '']


def test_a_resumed_run_keeps_the_orientation_it_was_begun_with(make) -> None:
    first = make(start=True, orientation='-z')
    first.until(lambda: first.node.snapshot.step.id == 'heat')
    first.node.run.conductor.close()
    again = make(profile='')
    again.step()
    (announcement,) = [
        parse_announcement(m.data) for topic, m in again.sent if topic == 'chamber/run'
    ]
    assert announcement.up_axis == '-z'


def test_a_full_disk_ends_in_the_safe_state(make, monkeypatch) -> None:
    harness = make(start=True)
    harness.until(lambda: harness.node.snapshot.step.id == 'heat')
    monkeypatch.setattr('chamber_profile.run.conductor.free_bytes', lambda _: 1 << 29)
    harness.step()
    assert harness.mode == SAFE
    assert 'GiB' in harness.node.snapshot.progress.reason


def test_a_journal_that_cannot_be_written_ends_in_the_safe_state(make, monkeypatch) -> None:
    harness = make(start=True)
    harness.until(lambda: harness.node.snapshot.step.id == 'heat')

    def fail(*_, **__):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('chamber_profile.run.journal.Journal.write', fail)
    harness.until(lambda: harness.mode in (SAFE, ABORTED))
    assert 'journal' in harness.node.snapshot.progress.reason
    harness.until(lambda: harness.mode == ABORTED)
    assert not harness.node.run.conductor.link.chamber.running
