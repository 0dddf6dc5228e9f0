# SPDX-License-Identifier: Apache-2.0
"""Real bags read as columns equal the same bags read message by message."""

from pathlib import Path

import numpy as np
import pytest
from anyreader_columns import columns
from imu_recording.logging_contract import STRING
from imu_recording.recorder.bag_recorder import BagRecorder
from imu_recording.ros.message_cdr import serialise
from imu_recording.ros.messages import ImuSample
from imu_recording.ros.sample_bytes import imu_to_bytes
from recording_samples import assert_same, make_recording
from std_msgs.msg import String

from imu_recording import bag_namespaces, read_bag, write_bag

CAMPAIGN_TRACKS = {
    '/imu/mag': ('magnetic_field', 'magnetic_field'),
    '/imu/temperature': ('temperature', 'temperature'),
    '/chamber/temperature': ('chamber_temperature', 'temperature'),
    '/chamber/device_temperature': ('device_temperature', 'temperature'),
    '/chamber/setpoint': ('setpoint', 'temperature'),
    '/chamber/heater': ('heater', 'data'),
    '/chamber/compressor': ('compressor', 'data'),
    '/imu/supply_voltage': ('supply_voltage', 'data'),
}


@pytest.mark.shared_data
@pytest.mark.parametrize(
    'bag', ['practice_a/run1', pytest.param('blind_e/run3', marks=pytest.mark.long)]
)
def test_campaign_equals_anyreader(shared: Path, bag: str) -> None:
    path = shared / 'campaigns' / bag
    recording = read_bag(path)
    imu = columns(path, '/imu/data_raw', 'angular_velocity', 'linear_acceleration')
    assert np.array_equal(recording.stamp, imu['stamp'])
    assert np.array_equal(recording.angular_velocity, imu['angular_velocity'])
    assert np.array_equal(recording.linear_acceleration, imu['linear_acceleration'])
    for topic, (field, name) in CAMPAIGN_TRACKS.items():
        found = getattr(recording, field)
        if found is None:
            continue
        wanted = columns(path, topic, name)
        assert np.array_equal(wanted['stamp'], recording.stamp)
        assert np.array_equal(found, wanted[name]), topic
    assert (recording.run, recording.device) == (bag[-1], bag.split('/', maxsplit=1)[0])


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('compression', ['zstd', 'none', 'message', 'file'])
def test_written_is_read_back_bit_for_bit(tmp_path: Path, storage: str, compression: str) -> None:
    recording = make_recording()
    write_bag(recording, tmp_path / 'bag', storage=storage, compression=compression)
    back = read_bag(tmp_path / 'bag')
    assert_same(recording, back)
    assert {note.split(': ')[1] for note in back.notes} == {'4 rows lie before its first sample'}
    assert bag_namespaces(tmp_path / 'bag') == ['']


def test_a_model_that_was_subtracted_for_a_part_of_the_time_is_told(tmp_path: Path) -> None:
    recorder = BagRecorder(tmp_path / 'bag', sync=False)
    for k in range(20):
        stamp = (k + 1) * 10_000_000
        imu = imu_to_bytes(ImuSample(stamp, (0.0, 0.0, 0.0), (0.0, 0.0, 9.8)))
        recorder.record('/imu_compensated/data_raw', 'sensor_msgs/msg/Imu', imu, stamp)
        if k in (0, 10):
            told = serialise(String(data='' if k else 'model of dut1'))
            recorder.record('/imu_compensated/applied_model', STRING, told, stamp)
    recorder.close()
    remap = {'imu/data_raw': 'imu_compensated/data_raw'}
    recording = read_bag(tmp_path / 'bag', remap=remap)
    assert recording.compensated == ''
    told_of = [note for note in recording.notes if 'applied_model' in note]
    assert len(told_of) == 1
    assert told_of[0].endswith(
        'not one model was subtracted from all of it, but model of dut1, none'
    )
