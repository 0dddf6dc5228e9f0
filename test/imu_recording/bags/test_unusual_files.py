# SPDX-License-Identifier: Apache-2.0
"""Bags of every odd kind: the same numbers as message by message, and a word about it."""

from __future__ import annotations

import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from anyreader_columns import columns
from imu_recording.bags.decoding.cdr import LAYOUTS
from imu_recording.logging_contract import IMU
from recording_samples import (
    START,
    TYPES,
    imu,
    magnetic,
    make_bag,
    plain,
    standard_messages,
    temperature,
)
from rosbags.convert import convert

from imu_recording import BagError, ImuRecording, bag_namespaces, read_bag


def assert_equals_anyreader(path: Path, recording: ImuRecording | None = None) -> ImuRecording:
    """Equal to AnyReader on the rows AnyReader has, in order of stamp."""
    recording = recording or read_bag(path)
    wanted = columns(path, '/imu/data_raw', 'angular_velocity', 'linear_acceleration')
    order = np.argsort(wanted['stamp'], kind='stable')
    assert np.array_equal(recording.stamp, wanted['stamp'][order])
    for name in ('angular_velocity', 'linear_acceleration'):
        assert np.array_equal(getattr(recording, name), wanted[name][order]), name
    field = columns(path, '/imu/mag', 'magnetic_field')
    assert np.array_equal(recording.magnetic_field, field['magnetic_field'])
    return recording


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_big_endian(tmp_path: Path, storage: str) -> None:
    path = make_bag(tmp_path / 'b', standard_messages(), storage=storage, big_endian=True)
    recording = assert_equals_anyreader(path)
    assert 'imu/data_raw: 50 messages of unusual layout decoded one by one' in recording.notes


@pytest.mark.parametrize('length', range(24))
def test_every_frame_id_length(tmp_path: Path, length: int) -> None:
    frame = 'f' * length
    messages = [('/imu/data_raw', START + i, imu(START + i, i, frame)) for i in range(3)]
    messages += [('/imu/mag', START + i, magnetic(START + i, i, frame)) for i in range(3)]
    recording = assert_equals_anyreader(make_bag(tmp_path / 'b', messages))
    assert recording.frame_id == frame
    assert not any('unusual' in note for note in recording.notes)
    size = len(TYPES.serialize_cdr(imu(START, 1.0, frame), IMU))
    assert LAYOUTS[IMU].size(length) == size


def test_frame_ids_that_differ_within_a_topic(tmp_path: Path) -> None:
    frames = ['imu_link', 'imu_lonk', 'imu', 'ïmu']
    messages = [('/imu/data_raw', START + i, imu(START + i, i, frames[i % 4])) for i in range(40)]
    messages += [('/imu/mag', START + i, magnetic(START + i, i)) for i in range(40)]
    recording = assert_equals_anyreader(make_bag(tmp_path / 'b', messages))
    assert any('several frame_ids: imu_link (10)' in note for note in recording.notes)


def version_2(message: object) -> bytes:
    """An Imu in plain XCDR version 2: doubles aligned to 4 bytes."""
    raw = bytes(TYPES.serialize_cdr(message, IMU))
    text = struct.unpack_from('<I', raw, 12)[0]
    body = LAYOUTS[IMU].body(text - 1)
    header = raw[4 : 16 + text].ljust(-(-(12 + text) // 4) * 4, b'\0')
    return b'\x00\x07\x00\x00' + header + raw[body:]


def test_xcdr_version_2_and_trailing_bytes(tmp_path: Path) -> None:
    frames = ['imu_link', 'i', 'imu']
    plain_messages = [imu(START + i, i, frames[i % 3]) for i in range(30)]
    odd = [version_2(message) for message in plain_messages]
    odd[5] = bytes(TYPES.serialize_cdr(plain_messages[5], IMU)) + b'\0\0\0'
    odd[6] = b'\x00\x01\x00\x03' + bytes(TYPES.serialize_cdr(plain_messages[6], IMU))[4:]
    path = make_bag(
        tmp_path / 'b', [('/imu/data_raw', START + i, raw) for i, raw in enumerate(odd)]
    )
    recording = read_bag(path)
    assert np.array_equal(recording.stamp, START + np.arange(30))
    assert np.array_equal(recording.angular_velocity[:, 1], 2.0 * np.arange(30))
    assert np.array_equal(recording.linear_acceleration, [[0.1, 0.2, 9.8]] * 30)


def test_damaged_messages_are_counted(tmp_path: Path) -> None:
    messages = standard_messages(20)
    messages[1] = ('/imu/data_raw', START, bytes(TYPES.serialize_cdr(imu(START), IMU))[:100])
    messages[4] = ('/imu/data_raw', START, b'')
    recording = read_bag(make_bag(tmp_path / 'b', messages))
    assert len(recording) == 18
    assert 'imu/data_raw: 2 damaged messages left out' in recording.notes


def test_another_definition_under_the_same_name(tmp_path: Path) -> None:
    """A type that only has the standard name is decoded by its own definition."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    own = get_typestore(Stores.ROS2_JAZZY)
    text = 'std_msgs/Header header\nfloat64 variance\nfloat64 temperature\n'
    types = get_typestore(Stores.EMPTY)
    kind = 'sensor_msgs/msg/Temperature'
    types.register(
        {**get_types_from_msg(text, kind)}
        | {k: own.fielddefs[k] for k in ('std_msgs/msg/Header', 'builtin_interfaces/msg/Time')}
    )
    writer = Writer(tmp_path / 'b', version=9, storage_plugin=StoragePlugin.MCAP)
    with writer:
        warm = writer.add_connection('/imu/temperature', kind, typestore=types)
        raw = writer.add_connection('/imu/data_raw', IMU, typestore=own)
        for i in range(5):
            message = temperature(START + i, 0.0)
            message.variance = 20.0 + i
            writer.write(warm, START + i, own.serialize_cdr(message, kind)[:])
            writer.write(raw, START + i, own.serialize_cdr(imu(START + i), IMU))
    recording = read_bag(tmp_path / 'b')
    assert recording.temperature.tolist() == [20.0, 21.0, 22.0, 23.0, 24.0]  # places changed
    wanted = columns(tmp_path / 'b', '/imu/temperature', 'temperature')
    assert np.array_equal(recording.temperature, wanted['temperature'])


def test_vectors_marked_as_not_reported_are_nan(tmp_path: Path) -> None:
    silent = np.array([-1.0] + [0.0] * 8)
    for endian in (False, True):
        messages = [
            ('/imu/data_raw', START + i, imu(START + i, 1.0, gyroscope_covariance=silent))
            for i in range(4)
        ]
        path = make_bag(tmp_path / f'b{endian}', messages, big_endian=endian)
        recording = read_bag(path)
        assert np.isnan(recording.angular_velocity).all()
        assert np.isfinite(recording.linear_acceleration).all()


def test_ros1_bag(tmp_path: Path) -> None:
    messages = standard_messages()
    messages += [('/chamber/heater', START + 10**7, plain('Float64', 0.5))]
    messages += [('/chamber/phase', START + 10**7, plain('String', 'ramp_up 2'))]
    path = make_bag(tmp_path / 'b', messages)
    ros1_bag(path, tmp_path / 'one.bag')
    one, two = read_bag(tmp_path / 'one.bag'), read_bag(path)
    assert np.array_equal(one.angular_velocity, two.angular_velocity)
    assert np.array_equal(one.temperature, two.temperature)
    assert np.array_equal(one.heater, two.heater, equal_nan=True)
    assert one.phase[1] == 3
    assert one.cycle[-1] == 2
    assert bag_namespaces(tmp_path / 'one.bag') == ['']


def ros1_bag(source: Path, target: Path) -> None:
    """Convert by rosbags' own converter."""
    from rosbags.typesys import Stores, get_typestore

    convert(
        [source], target, dst_storage='', dst_version=0, compress=None, compress_mode='none',
        default_typestore=get_typestore(Stores.ROS2_JAZZY),
        typestore=get_typestore(Stores.ROS1_NOETIC),
        exclude_topics=[], include_topics=[], exclude_msgtypes=[], include_msgtypes=[],
    )  # fmt: skip


@pytest.mark.parametrize(
    ('content', 'said'),
    [
        (b'', 'the bag is empty'),
        (b'nonsense and more', 'neither mcap nor sqlite3 nor a ROS 1 bag'),
        (b'\x89MCAP0\r\n', 'no topics in it'),
        (b'SQLite format 3\x00' + b'\0' * 100, 'sqlite3'),
        (b'#ROSBAG V2.0\n', 'ROS 1'),
        (b'\x28\xb5\x2f\xfd' + b'\0' * 20, 'not an mcap file'),
    ],
)
def test_files_that_are_no_bag(tmp_path: Path, content: bytes, said: str) -> None:
    file = tmp_path / 'b.mcap'
    file.write_bytes(content)
    with pytest.raises(BagError, match=said) as raised:
        read_bag(file)
    assert str(file) in str(raised.value)
    assert '\n' not in str(raised.value)


def test_folders_that_are_no_bag(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='no such file'):
        read_bag(tmp_path / 'missing')
    with pytest.raises(BagError, match='no bag in this folder'):
        read_bag(tmp_path)
    make_bag(tmp_path / 'inner', standard_messages(2))
    with pytest.raises(BagError, match='folder of bags; name one: inner'):
        read_bag(tmp_path)
    shutil.rmtree(tmp_path / 'inner')
    (tmp_path / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information: {relative_file_paths: [x.mcap]}'
    )
    with pytest.raises(BagError, match=r'x\.mcap named in metadata\.yaml is missing'):
        read_bag(tmp_path)
    with pytest.raises(BagError, match='no bag given'):
        read_bag([])


def test_bag_without_samples(tmp_path: Path) -> None:
    path = make_bag(tmp_path / 'b', standard_messages(1)[:1])
    with pytest.raises(BagError, match='no topic imu/data_raw; it has /imu/temperature'):
        read_bag(path)
