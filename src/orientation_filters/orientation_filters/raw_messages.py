# SPDX-License-Identifier: Apache-2.0
"""Samples from serialised sensor_msgs, as a raw subscription delivers them.

Half the cost of a message in Python is its conversion to an object; above 500 Hz it shows.
Layout (CDR, little endian): encapsulation, stamp, frame_id, then doubles on eight-byte places.
"""

from __future__ import annotations

import struct
from math import nan

from imu_recording.ros.messages import ImuSample, MagneticSample

_HEADER = struct.Struct('<iII')
_IMU = struct.Struct('<37d')
_FIELD = struct.Struct('<12d')
LITTLE_ENDIAN = b'\x00\x01'


def _header(data: bytes) -> tuple[int, str, int]:
    """Return stamp [ns], frame_id and the place of the first double."""
    if data[:2] != LITTLE_ENDIAN:
        raise ValueError(f'encapsulation {data[:2].hex()} is not little-endian CDR (0001)')
    seconds, nanoseconds, length = _HEADER.unpack_from(data, 4)
    frame_id = bytes(data[16 : 15 + length]).decode('utf-8', 'replace')
    return seconds * 1_000_000_000 + nanoseconds, frame_id, 4 + (12 + length + 7) // 8 * 8


def imu_from_bytes(data: bytes) -> ImuSample:
    """Return the sample of a serialised sensor_msgs/Imu."""
    stamp, frame_id, start = _header(data)
    values = _IMU.unpack_from(data, start)
    w, f = values[13:16], values[25:28]
    return ImuSample(
        stamp,
        (nan, nan, nan) if values[16] == -1.0 else (w[0], w[1], w[2]),
        (nan, nan, nan) if values[28] == -1.0 else (f[0], f[1], f[2]),
        values[16:25],
        values[28:37],
        frame_id,
    )


def field_from_bytes(data: bytes) -> MagneticSample:
    """Return the sample of a serialised sensor_msgs/MagneticField."""
    stamp, frame_id, start = _header(data)
    values = _FIELD.unpack_from(data, start)
    return MagneticSample(stamp, (values[0], values[1], values[2]), values[3:12], frame_id)
