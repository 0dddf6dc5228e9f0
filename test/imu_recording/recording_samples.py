# SPDX-License-Identifier: Apache-2.0
"""Recordings and bags for tests, made from a seed."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from imu_recording import ImuRecording

START = 1_700_000_000_000_000_000
TYPES = get_typestore(Stores.ROS2_JAZZY)


def make_recording(n: int = 200, *, seed: int = 1, step_ns: int = 20_000_000) -> ImuRecording:
    """A recording with every track, magnetometer gaps, held chamber tracks and a known phase."""
    rng = np.random.default_rng(seed)
    acceleration = rng.normal(0, 0.1, (n, 3)) + [0.0, 0.0, 9.8]
    magnetic = rng.normal(0, 4e-5, (n, 3))
    magnetic[3::7] = np.nan
    held = np.repeat(np.arange(n // 10 + 1.0), 10)[:n]
    air = 20.0 + held
    air[:4] = np.nan
    return ImuRecording(
        stamp=START + step_ns * np.arange(n),
        angular_velocity=rng.normal(0, 0.01, (n, 3)),
        linear_acceleration=acceleration,
        magnetic_field=magnetic,
        temperature=25 + rng.normal(0, 0.1, n),
        chamber_temperature=air,
        chamber_temperature_2=air + 0.1,
        device_temperature=air - 0.3,
        setpoint=20.0 + held,
        humidity=0.4 + 0 * held,
        pressure=101_325.0 + 10.0 * held,
        heater=rng.random(n),
        compressor=held % 2,
        fan=np.ones(n),
        supply_voltage=3.3 + rng.normal(0, 1e-3, n),
        vibration=rng.random((n, 3)),
        phase=np.minimum(np.arange(n) // 40, 6),
        cycle=1 + np.arange(n) // 100,
        reference_orientation=rng.normal(size=(n, 4)),
        frame_id='imu_link',
        device='dut1',
        run='1',
        up_axis='+z',
        profile='paper_betta2022',
    )


def recording_at_rest(n: int, seed: int = 1) -> ImuRecording:
    """A sample each millisecond of a board that lies still and warms by 10 K."""
    rng = np.random.default_rng(seed)
    return ImuRecording(
        stamp=np.arange(n) * 1_000_000,
        angular_velocity=rng.normal(0.0, 0.01, (n, 3)),
        linear_acceleration=rng.normal(0.0, 0.05, (n, 3)) + [0.0, 0.0, -9.8],
        magnetic_field=np.full((n, 3), 2e-5),
        temperature=np.linspace(20.0, 30.0, n),
        device='dut',
    )


def arrays(recording: ImuRecording) -> dict[str, Any]:
    """The tracks a recording has, by name."""
    values = {f.name: getattr(recording, f.name) for f in fields(recording)}
    return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}


def assert_same(a: ImuRecording, b: ImuRecording) -> None:
    """Equal in every bit of every track and in the metadata."""
    first, second = arrays(a), arrays(b)
    assert sorted(first) == sorted(second)
    for name, value in first.items():
        assert value.dtype == second[name].dtype, name
        assert value.tobytes() == second[name].tobytes(), name
    for name in ('frame_id', 'device', 'run', 'up_axis', 'profile', 'namespace'):
        assert getattr(a, name) == getattr(b, name), name


def without_tracks(recording: ImuRecording) -> ImuRecording:
    """Only what every recording has."""
    optional = {f.name: None for f in fields(recording) if str(f.type).endswith('| None')}
    return replace(recording, **optional)


def imu(stamp: int, value: float = 1.0, frame: str = 'imu_link', **changes: Any) -> Any:
    """An Imu message, level, with the value as angular velocity."""
    message = TYPES.types
    vector = message['geometry_msgs/msg/Vector3']
    return message['sensor_msgs/msg/Imu'](
        header=header(stamp, frame),
        orientation=message['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
        orientation_covariance=np.array([-1.0] + [0.0] * 8),
        angular_velocity=vector(value, 2 * value, -value),
        angular_velocity_covariance=changes.get('gyroscope_covariance', np.zeros(9)),
        linear_acceleration=vector(0.1, 0.2, 9.8),
        linear_acceleration_covariance=np.zeros(9),
    )


def header(stamp: int, frame: str = 'imu_link') -> Any:
    time = TYPES.types['builtin_interfaces/msg/Time'](*divmod(stamp, 10**9))
    return TYPES.types['std_msgs/msg/Header'](time, frame)


def magnetic(stamp: int, value: float = 1e-5, frame: str = 'imu_link') -> Any:
    vector = TYPES.types['geometry_msgs/msg/Vector3'](value, 0.0, -4e-5)
    kind = TYPES.types['sensor_msgs/msg/MagneticField']
    return kind(header(stamp, frame), vector, np.zeros(9))


def temperature(stamp: int, value: float = 20.0, frame: str = 'imu_link') -> Any:
    return TYPES.types['sensor_msgs/msg/Temperature'](header(stamp, frame), value, 0.0)


def plain(kind: str, data: Any) -> Any:
    return TYPES.types[f'std_msgs/msg/{kind}'](data)


def make_bag(
    path: Path,
    messages: list[tuple[str, int, Any]],
    *,
    storage: str = 'mcap',
    compression: str = 'none',
    custom: dict[str, str] | None = None,
    big_endian: bool = False,
) -> Path:
    """Write (topic, receipt, message or bytes of an Imu) as a bag through rosbags."""
    plugin = {'mcap': StoragePlugin.MCAP, 'sqlite3': StoragePlugin.SQLITE3}[storage]
    writer = Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    for key, value in (custom or {}).items():
        writer.set_custom_data(key, value)
    with writer:
        connections: dict[str, Any] = {}
        for topic, received, message in messages:
            raw = isinstance(message, bytes)
            kind = 'sensor_msgs/msg/Imu' if raw else message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
            data = (
                message
                if raw
                else TYPES.serialize_cdr(message, kind, little_endian=not big_endian)
            )
            writer.write(connections[topic], received, data)
    return path


def standard_messages(n: int = 50, step_ns: int = 10_000_000) -> list[tuple[str, int, Any]]:
    """The three IMU topics, temperature first among equal stamps."""
    messages: list[tuple[str, int, Any]] = []
    for i in range(n):
        stamp = START + i * step_ns
        messages += [
            ('/imu/temperature', stamp, temperature(stamp, 20 + 0.01 * i)),
            ('/imu/data_raw', stamp, imu(stamp, float(i))),
            ('/imu/mag', stamp, magnetic(stamp, 1e-6 * i)),
        ]
    return messages
