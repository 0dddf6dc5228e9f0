# SPDX-License-Identifier: Apache-2.0
"""Samples from and to serialised messages, as raw subscriptions and publishers carry them.

Most of the cost of a message in Python is its conversion from and to an object. Layout (CDR,
little endian): encapsulation header 00 01 00 00, stamp (int32, uint32), frame_id (uint32 length
with its zero, characters), doubles aligned to 8 counted from byte 4 (OMG DDS-XTypes 1.3, 7.4.3).
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from math import nan
from typing import Any

from imu_recording.bags.decoding.cdr import ENCAPSULATION, LITTLE_ENDIAN
from imu_recording.recording import SECOND_NS
from imu_recording.ros import messages
from imu_recording.ros.messages import (
    ImuSample,
    MagneticSample,
    TemperatureSample,
    VectorSample,
)

_HEADER = struct.Struct('<iII')
_STAMP = struct.Struct('<iI')
_IMU = struct.Struct('<37d')
_FIELD = struct.Struct('<12d')
_TEMPERATURE = struct.Struct('<2d')
_VECTOR = struct.Struct('<3d')


def _read_header(data: bytes) -> tuple[int, str, int]:
    """Return stamp [ns], frame_id and the place of the first double."""
    if data[:2] != LITTLE_ENDIAN:
        raise ValueError(f'encapsulation {data[:2].hex()} is not little-endian CDR (0001)')
    seconds, nanoseconds, length = _HEADER.unpack_from(data, 4)
    frame_id = bytes(data[16 : 15 + length]).decode('utf-8', 'replace')
    return seconds * SECOND_NS + nanoseconds, frame_id, 4 + (12 + length + 7) // 8 * 8


def stamp_from_bytes(data: bytes) -> int:
    """Return the stamp [ns] of any message that begins with a header; −1 if it is big-endian."""
    if data[:2] != LITTLE_ENDIAN:
        return -1
    seconds, nanoseconds = _STAMP.unpack_from(data, 4)
    return int(seconds) * SECOND_NS + int(nanoseconds)


@lru_cache(maxsize=64)
def _frame(frame_id: str) -> bytes:
    """Return what stands between the stamp and the first double."""
    name = frame_id.encode() + b'\0'
    return struct.pack('<I', len(name)) + name + bytes(-(12 + len(name)) % 8)


def _header(stamp: int, frame_id: str) -> bytes:
    return ENCAPSULATION + _STAMP.pack(*divmod(stamp, SECOND_NS)) + _frame(frame_id)


def imu_from_bytes(data: bytes) -> ImuSample:
    """Return the sample of a serialised sensor_msgs/Imu; vectors not reported are NaN."""
    stamp, frame_id, start = _read_header(data)
    values = _IMU.unpack_from(data, start)
    rate = (nan, nan, nan) if values[16] == -1.0 else (values[13], values[14], values[15])
    force = (nan, nan, nan) if values[28] == -1.0 else (values[25], values[26], values[27])
    return ImuSample(
        stamp=stamp,
        angular_velocity=rate,
        linear_acceleration=force,
        angular_velocity_covariance=values[16:25],
        linear_acceleration_covariance=values[28:37],
        frame_id=frame_id,
        orientation=(values[0], values[1], values[2], values[3]),
        orientation_covariance=values[4:13],
    )


def imu_to_bytes(sample: ImuSample) -> bytes:
    """Return the serialised sensor_msgs/Imu of a sample."""
    return _header(sample.stamp, sample.frame_id) + _IMU.pack(
        *sample.orientation,
        *sample.orientation_covariance,
        *sample.angular_velocity,
        *sample.angular_velocity_covariance,
        *sample.linear_acceleration,
        *sample.linear_acceleration_covariance,
    )


def field_from_bytes(data: bytes) -> MagneticSample:
    """Return the sample of a serialised sensor_msgs/MagneticField."""
    stamp, frame_id, start = _read_header(data)
    values = _FIELD.unpack_from(data, start)
    return MagneticSample(stamp, (values[0], values[1], values[2]), values[3:12], frame_id)


def field_to_bytes(sample: MagneticSample) -> bytes:
    """Return the serialised sensor_msgs/MagneticField of a sample."""
    return _header(sample.stamp, sample.frame_id) + _FIELD.pack(
        *sample.magnetic_field, *sample.magnetic_field_covariance
    )


def temperature_from_bytes(data: bytes) -> TemperatureSample:
    """Return the sample of a serialised sensor_msgs/Temperature."""
    stamp, frame_id, start = _read_header(data)
    temperature, variance = _TEMPERATURE.unpack_from(data, start)
    return TemperatureSample(stamp, temperature, variance, frame_id)


def temperature_to_bytes(sample: TemperatureSample) -> bytes:
    """Return the serialised sensor_msgs/Temperature of a sample."""
    return _header(sample.stamp, sample.frame_id) + _TEMPERATURE.pack(
        sample.temperature, sample.variance
    )


def vector_from_bytes(data: bytes) -> VectorSample:
    """Return the sample of a serialised geometry_msgs/Vector3Stamped."""
    stamp, frame_id, start = _read_header(data)
    x, y, z = _VECTOR.unpack_from(data, start)
    return VectorSample(stamp, (x, y, z), frame_id)


def vector_to_bytes(sample: VectorSample) -> bytes:
    """Return the serialised geometry_msgs/Vector3Stamped of a sample."""
    return _header(sample.stamp, sample.frame_id) + _VECTOR.pack(*sample.vector)


@dataclass(frozen=True)
class SampleForm:
    """How the samples of one message type become messages, and messages samples."""

    from_bytes: Callable[[bytes], Any]
    to_bytes: Callable[[Any], bytes]
    from_message: Callable[[Any], Any]
    to_message: Callable[[Any], Any]


@cache
def form_of(message_type: type) -> SampleForm:
    """Return the form of sensor_msgs Imu, MagneticField or Temperature, or of Vector3Stamped."""
    return {
        'Imu': SampleForm(
            from_bytes=imu_from_bytes,
            to_bytes=imu_to_bytes,
            from_message=messages.sample_from_imu,
            to_message=messages.imu_from_sample,
        ),
        'MagneticField': SampleForm(
            from_bytes=field_from_bytes,
            to_bytes=field_to_bytes,
            from_message=messages.sample_from_magnetic_field,
            to_message=messages.magnetic_field_from_sample,
        ),
        'Temperature': SampleForm(
            from_bytes=temperature_from_bytes,
            to_bytes=temperature_to_bytes,
            from_message=messages.sample_from_temperature,
            to_message=messages.temperature_from_sample,
        ),
        'Vector3Stamped': SampleForm(
            from_bytes=vector_from_bytes,
            to_bytes=vector_to_bytes,
            from_message=messages.sample_from_vector,
            to_message=messages.vector_from_sample,
        ),
    }[message_type.__name__]
