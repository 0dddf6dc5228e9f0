# SPDX-License-Identifier: Apache-2.0
"""Real bags read as columns equal the same bags read message by message."""

from pathlib import Path

import numpy as np
import pytest
from anyreader_columns import columns
from recording_samples import assert_same, make_recording

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
@pytest.mark.parametrize('bag', ['practice_a/run1', 'blind_e/run3'])
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
