# SPDX-License-Identifier: Apache-2.0
"""Every bag that ships reads as message by message, without rclpy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from anyreader_columns import columns

from imu_recording import read_bag, write_bag

BAGS = ['dut1_x', pytest.param('dut1_motion', marks=pytest.mark.long)]
"""The others are written alike."""

WITHOUT_ROS = """
import sys
for name in ('rclpy', 'sensor_msgs', 'std_msgs', 'geometry_msgs', 'launch', 'launch_ros'):
    sys.modules[name] = None
from imu_recording import read_bag, write_bag
from imu_recording.tables.csv_import import import_csv
recording = read_bag(sys.argv[1])
write_bag(recording, sys.argv[2])
print(len(read_bag(sys.argv[2])))
"""


def test_every_bag_says_what_simulated_it(bags: Path, tmp_path: Path) -> None:
    shipped = sorted(path.parent for path in bags.glob('*/metadata.yaml'))
    assert len(shipped) == 13
    said = {path.name: read_bag(path).simulated for path in shipped}
    assert set(said.values()) == {'imu_driver.simulation'}, said
    write_bag(read_bag(shipped[0]), tmp_path / 'copy')
    assert read_bag(tmp_path / 'copy').simulated == 'imu_driver.simulation'


def test_a_replay_offers_what_the_nodes_did(bags: Path, tmp_path: Path) -> None:
    shipped = sorted(path.parent for path in bags.glob('*/metadata.yaml'))
    write_bag(read_bag(shipped[-1]), tmp_path / 'copy')
    for path in (*shipped, tmp_path / 'copy'):
        content = yaml.safe_load((path / 'metadata.yaml').read_text())
        topics = content['rosbag2_bagfile_information']['topics_with_message_count']
        for topic in (entry['topic_metadata'] for entry in topics):
            (profile,) = topic['offered_qos_profiles']
            latched = topic['name'] == '/chamber/phase'
            assert profile['reliability'] == 'reliable'
            assert profile['durability'] == ('transient_local' if latched else 'volatile')


@pytest.mark.parametrize('name', BAGS)
def test_equals_anyreader(bags: Path, name: str) -> None:
    recording = read_bag(bags / name)
    imu = columns(bags / name, '/imu/data_raw', 'angular_velocity', 'linear_acceleration')
    assert np.array_equal(recording.stamp, imu['stamp'])
    assert np.array_equal(recording.angular_velocity, imu['angular_velocity'])
    assert np.array_equal(recording.linear_acceleration, imu['linear_acceleration'])
    if name == 'dut1_x':
        field = columns(bags / name, '/imu/mag', 'magnetic_field')
        rows = np.searchsorted(recording.stamp, field['stamp'])
        assert np.array_equal(recording.magnetic_field[rows], field['magnetic_field'])
        warm = columns(bags / name, '/chamber/temperature', 'temperature')
        newest = np.searchsorted(warm['stamp'], recording.stamp, side='right') - 1
        assert recording.chamber_temperature is not None
        held = np.where(newest < 0, np.nan, warm['temperature'][newest])
        assert np.array_equal(recording.chamber_temperature, held, equal_nan=True)


def test_reading_and_writing_need_no_ros(bags: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, '-c', WITHOUT_ROS, str(bags / 'dut1_x'), str(tmp_path / 'b')],
        capture_output=True,
        text=True,
        check=True,
    )
    assert int(done.stdout) == len(read_bag(bags / 'dut1_x'))
