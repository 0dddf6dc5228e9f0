# SPDX-License-Identifier: Apache-2.0
"""The recorder as a node: what it subscribes to, what it writes, what it says when it cannot."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from imu_recording.bags.files import locate_bag
from imu_recording.recorder.node import RecorderNode
from imu_recording.recorder.plan import (
    RecorderConfig,
    output_folder,
    parse_split,
    recording_metadata,
)
from imu_recording.ros.messages import ImuSample, imu_from_sample
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import Imu

from imu_recording import BagError, RecordingError, read_bag

START = 1_700_000_000_000_000_000
RUN = 'from imu_recording.recorder.node import main; raise SystemExit(main())'


def imu_bytes(i: int) -> bytes:
    return serialize_message(imu_from_sample(ImuSample(START + i, (i, 0, 0), (0, 0, 9.8))))


def make_node(folder: Path, **parameters: Any) -> tuple[RecorderNode, list[Any]]:
    sent: list[Any] = []
    node = RecorderNode(
        capture=lambda topic, message: sent.append(message),
        now=lambda: START,
        parameters={'output': str(folder), **parameters},
    )
    return node, sent


def test_records_raw_bytes(ros: Any, tmp_path: Path) -> None:
    profile = tmp_path / 'short.yaml'
    profile.write_text('schema: 1\n')
    node, _ = make_node(tmp_path / 'bag', device='dut1', up_axis='+z', profile=str(profile))
    assert node.autostart()
    node.subscribe('/imu/data_raw', 'sensor_msgs/msg/Imu')
    for i in range(50):
        node.inputs['/imu/data_raw'](imu_bytes(i))
    node.flush()
    assert len(read_bag(tmp_path / 'bag')) == 50
    node.trigger_deactivate()
    recording = read_bag(tmp_path / 'bag')
    assert np.array_equal(recording.angular_velocity[:, 0], np.arange(50))
    assert (recording.device, recording.profile) == ('dut1', 'short')
    assert not any('not closed' in note for note in recording.notes)
    node.destroy_node()


def test_it_tells_its_health_before_its_folder_exists(
    ros: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    node, sent = make_node(Path())  # recordings/<UTC>, which the first message makes
    node.set_parameters([Parameter('output', value='')])
    assert node.autostart()
    node.publish_diagnostics()
    values = {item.key: item.value for item in sent[-1].status[0].values}
    assert values['folder'].startswith('recordings/')
    assert int(values['free_bytes']) > 0
    assert not (tmp_path / 'recordings').exists()
    node.destroy_node()


def test_a_failure_ends_the_recording_and_is_an_error(ros: Any, tmp_path: Path) -> None:
    node, sent = make_node(tmp_path / 'bag')
    node.autostart()
    node.subscribe('/imu/data_raw', 'sensor_msgs/msg/Imu')
    node.subscribe('/other', 'not_installed_msgs/msg/Thing')
    node.publish_diagnostics()
    assert sent[-1].status[0].level == b'\x01'
    assert 'types not installed: /other' in sent[-1].status[0].message
    node.inputs['/imu/data_raw'](imu_bytes(0))
    node.flush()

    def full(*arguments: Any, **options: Any) -> None:
        raise BagError('bag_0.mcap: cannot be written (No space left on device)')

    node.recorder.record = full
    node.inputs['/imu/data_raw'](imu_bytes(1))
    assert sent[-1].status[0].level == b'\x02'
    assert 'No space left' in sent[-1].status[0].message
    assert len(read_bag(tmp_path / 'bag')) == 1
    node.destroy_node()


def test_wrong_parameters_are_refused(ros: Any, tmp_path: Path) -> None:
    for parameters in ({'split': 'daily'}, {'up_axis': 'up'}, {'metadata': ['x']}):
        node, _ = make_node(tmp_path / 'bag', **parameters)
        assert not node.autostart()
        node.destroy_node()


def test_settings(tmp_path: Path) -> None:
    assert parse_split('phase,20mb') == (True, 20_000_000)
    with pytest.raises(RecordingError, match="split is '0 MB'"):
        parse_split('0 MB')
    assert output_folder('').parent == Path('recordings')
    (tmp_path / 'profile.yaml').write_text('a')
    metadata = recording_metadata(
        tmp_path, RecorderConfig(profile='p', metadata=['operator = me'])
    )
    assert metadata['profile'] == 'p'
    assert len(metadata['profile_sha256']) == 64
    assert metadata['operator'] == 'me'
    with pytest.raises(RecordingError, match=r'profile gone\.yaml: no such file'):
        recording_metadata(tmp_path, RecorderConfig(profile='gone.yaml'))


@pytest.mark.end_to_end
def test_killed_process_keeps_all_but_the_last_second(ros_network: Any, tmp_path: Path) -> None:
    """A real recorder over DDS, discovered topics, kill -9 in the middle."""
    from geometry_msgs.msg import Vector3Stamped
    from rclpy.node import Node
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from sensor_msgs.msg import Imu

    node = Node('source')
    publisher = node.create_publisher(Imu, 'imu/data_raw', 500)
    poor = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    other = node.create_publisher(Vector3Stamped, 'imu/vibration', poor)
    child = subprocess.Popen(
        [sys.executable, '-c', RUN, '--ros-args',
         '-p', f'output:={tmp_path / "bag"}', '-p', 'topics:=[imu/*]'],
    )  # fmt: skip
    try:
        until(lambda: publisher.get_subscription_count() and other.get_subscription_count(), 120)
        sent: list[float] = []
        file = tmp_path / 'bag' / 'bag_0.mcap'

        def publish() -> bool:
            message = imu_from_sample(ImuSample(START + len(sent), (len(sent), 0, 0), (0, 0, 9.8)))
            publisher.publish(message)
            other.publish(Vector3Stamped(header=message.header))
            sent.append(time.monotonic())
            return sent[-1] - sent[0] > 3.3 and file.is_file()

        until(publish, 120)
    finally:
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
    killed = time.monotonic()
    recording = read_bag(tmp_path / 'bag')
    owed = sum(moment < killed - 1.5 for moment in sent)
    assert len(recording) >= owed > 10
    assert np.array_equal(recording.angular_velocity[:owed, 0], np.arange(owed))
    assert recording.vibration is not None
    again = RecorderNode(capture=lambda *_: None, parameters={'output': str(tmp_path / 'bag')})
    assert again.autostart()  # which repairs what the kill has cut
    with AnyReader([tmp_path / 'bag']) as reader:
        assert reader.message_count >= 2 * owed
        offered = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
    assert offered['/imu/data_raw'].reliability.name == 'RELIABLE'
    assert offered['/imu/vibration'].reliability.name == 'BEST_EFFORT'
    assert len(read_bag(tmp_path / 'bag')) == len(recording)
    again.destroy_node()
    node.destroy_node()


def until(condition: Any, seconds: float) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, 'timed out'
        time.sleep(0.01)


def test_what_did_not_arrive_is_said_in_diagnostics_and_metadata(ros: Any, tmp_path: Path) -> None:
    node = RecorderNode(capture=lambda *_: None, parameters={'output': str(tmp_path / 'bag')})
    assert node.autostart()
    node.subscribe('/imu/data_raw', 'sensor_msgs/msg/Imu')
    for i in [*range(40), *range(45, 50)]:
        node.inputs['/imu/data_raw'](imu_bytes(i * 10_000_000))
    node.flush()
    level, line, values = node.losses.applied(node.diagnostics())
    assert (level, values['samples_missing']) == (1, 5)
    assert line.startswith('5 samples missing')
    node.end()
    node.destroy_node()
    custom = locate_bag(tmp_path / 'bag').custom
    assert custom['messages_lost'] == '/imu/data_raw 5'


def test_device_and_simulated_board_are_named_in_the_bag_that_is_under_way(
    ros: Any, tmp_path: Path
) -> None:
    board = ros.create_node('imu_driver', namespace='/dut1')
    publisher = board.create_publisher(Imu, 'imu/data_raw', 10)
    node = RecorderNode(parameters={'output': str(tmp_path / 'bag')})
    assert node.autostart()
    node.subscribe('/dut1/imu/data_raw', 'sensor_msgs/msg/Imu')
    until(lambda: node.spaces_of('dut1/imu_driver') == ['/dut1'], 10)
    data = serialize_message(imu_from_sample(ImuSample(START, (0, 0, 0), (0, 0, 9.8))))
    node.inputs['/dut1/imu/data_raw'](data)
    node.flush()
    for name, source in (('other/imu_driver', 'dut9'), ('dut1/imu_driver', 'dut1')):
        values = [KeyValue(key='transport', value=f'simulated://{source}')]
        status = DiagnosticStatus(
            name=f'{name}: stream', hardware_id=source.upper(), values=values
        )
        node.on_diagnostics(DiagnosticArray(status=[status]))
    exchanged = DiagnosticStatus(name='dut1/imu_driver: stream', hardware_id='DUT2')
    node.on_diagnostics(DiagnosticArray(status=[exchanged]))
    (tmp_path / 'bag' / 'metadata.yaml').rename(tmp_path / 'moved.yaml')
    recording = read_bag(tmp_path / 'bag', namespace='dut1')
    assert recording.simulated == 'simulated://dut1'
    assert recording.device == 'DUT1'
    assert 'simulated://dut1' in (tmp_path / 'moved.yaml').read_text()
    node.destroy_node()
    board.destroy_publisher(publisher)
    board.destroy_node()


def test_a_recorder_that_gets_nothing_says_so_and_what_there_is(
    ros: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('imu_recording.ros.diagnostics.FIRST_INPUT_S', 0.0)
    driver = ros.create_node('imu_driver', namespace='/silent')
    publishers = [driver.create_publisher(Imu, t, 10) for t in ('imu/data_raw', 'imu/mag')]
    said = {}
    for topics in ('/nix/*', '/silent/imu/data_row', '/silent/imu/mag'):
        folder = tmp_path / str(len(said))
        parameters = {'output': str(folder), 'topics': [topics, '/chamber/*']}
        node = RecorderNode(parameters=parameters)
        assert node.autostart()
        until(lambda node=node: node.count_publishers('/silent/imu/mag'), 10)
        node.discover()
        level, said[topics], _ = node._statuses()['input']
        assert level == 1
        node.destroy_node()
    assert said == {
        '/nix/*': '/nix/*, /chamber/* has no publisher; /silent/imu/data_raw, /silent/imu/mag has',
        '/silent/imu/data_row': '/silent/imu/data_row has no publisher; '
        '/silent/imu/data_raw, /silent/imu/mag has',
        '/silent/imu/mag': '/silent/imu/mag has a publisher, but no message came',
    }
    for publisher in publishers:
        driver.destroy_publisher(publisher)
