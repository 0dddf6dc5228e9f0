# SPDX-License-Identifier: Apache-2.0
"""Every bag that ships reads as message by message, without rclpy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from anyreader_columns import columns

from imu_recording import read_bag

BAGS = [f'dut{device}_{axis}' for device in (1, 2, 3) for axis in 'xyz'] + ['dut1_motion']

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


def test_without_numba_the_same_numbers(bags: Path, tmp_path: Path) -> None:
    """The undecorated kernels give what the compiled ones give."""
    from imu_recording.bags import cdr_decode, sqlite_pages

    from imu_recording import write_bag

    short = read_bag(bags / 'dut1_motion').rows(slice(0, 60))
    write_bag(short, tmp_path / 'm')
    write_bag(short, tmp_path / 's', storage='sqlite3')
    code = f"""
import sys
sys.modules['numba'] = None
import numpy as np
from imu_recording import read_bag, write_bag
from imu_recording.jit import NUMBA
assert not NUMBA
for name in ('m', 's'):
    recording = read_bag({str(tmp_path)!r} + '/' + name)
    np.savez({str(tmp_path)!r} + '/' + name, recording.angular_velocity, recording.stamp)
"""
    subprocess.run([sys.executable, '-c', code], check=True)
    assert hasattr(cdr_decode.decode_messages, 'py_func')
    assert hasattr(sqlite_pages.read_leaves, 'py_func')
    for name in 'ms':
        with np.load(tmp_path / f'{name}.npz') as found:
            assert np.array_equal(found['arr_0'], short.angular_velocity)
            assert np.array_equal(found['arr_1'], short.stamp)
