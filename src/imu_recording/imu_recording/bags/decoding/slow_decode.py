# SPDX-License-Identifier: Apache-2.0
"""Decode one message at a time through rosbags, where the compiled kernels know no layout."""

from __future__ import annotations

import struct
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError
from rosbags.typesys.store import Typestore

from imu_recording.bags.decoding.cdr import LAYOUTS
from imu_recording.bags.decoding.message_types import DecodeError
from imu_recording.logging_contract import STRING
from imu_recording.recording import SECOND_NS

Values = tuple[tuple[float, ...], ...]

_VALUES_OF_TYPE: dict[str, Any] = {
    'sensor_msgs/msg/Imu': lambda m: (
        _vector(m.angular_velocity, m.angular_velocity_covariance),
        _vector(m.linear_acceleration, m.linear_acceleration_covariance),
    ),
    'sensor_msgs/msg/MagneticField': lambda m: (_vector(m.magnetic_field),),
    'sensor_msgs/msg/Temperature': lambda m: ((m.temperature,),),
    'sensor_msgs/msg/RelativeHumidity': lambda m: ((m.relative_humidity,),),
    'sensor_msgs/msg/FluidPressure': lambda m: ((m.fluid_pressure,),),
    'geometry_msgs/msg/Vector3Stamped': lambda m: (_vector(m.vector),),
    'geometry_msgs/msg/QuaternionStamped': lambda m: (
        (m.quaternion.x, m.quaternion.y, m.quaternion.z, m.quaternion.w),
    ),
    'std_msgs/msg/Float64': lambda m: ((m.data,),),
}


_DEFINITION_ERRORS = (IndexError, AttributeError, TypeError, ValueError, KeyError)
"""Errors of decoding a message of another definition under the same name."""


def decode_message(
    raw: bytes, message_type: str, types: Typestore
) -> tuple[int | None, Values, str]:
    """Return stamp [ns] (None without header), column groups and frame_id of one message."""
    if raw[:2] in (b'\x00\x06', b'\x00\x07') and message_type in LAYOUTS:
        return _decode_version_2(raw, message_type)
    try:
        message: Any = types.deserialize_cdr(raw, message_type)
        return values_of(message, message_type)
    except (SerdeError, TypesysError, struct.error, *_DEFINITION_ERRORS) as error:
        raise DecodeError(str(error)) from None


def values_of(message: Any, message_type: str) -> tuple[int | None, Values, str]:
    """Return stamp, column groups and frame_id of a rosbags message object."""
    if message_type == STRING:
        return None, (), str(message.data)
    values: Values = _VALUES_OF_TYPE[message_type](message)
    if not LAYOUTS[message_type].stamped:
        return None, values, ''
    stamp = message.header.stamp
    return stamp.sec * SECOND_NS + stamp.nanosec, values, message.header.frame_id


def _vector(vector: Any, covariance: Any = (0.0,)) -> tuple[float, float, float]:
    if covariance[0] == -1.0:
        nan = float('nan')
        return nan, nan, nan
    return vector.x, vector.y, vector.z


def _decode_version_2(raw: bytes, message_type: str) -> tuple[int | None, Values, str]:
    """Decode plain XCDR version 2, where doubles align to 4 bytes (DDS-XTypes 1.3, 7.4.3)."""
    layout = LAYOUTS[message_type]
    order = '<' if raw[1] == 7 else '>'
    stamp, frame, at = None, '', 4
    try:
        if layout.stamped:
            seconds, nanoseconds, length = struct.unpack_from(f'{order}iII', raw, 4)
            stamp = seconds * SECOND_NS + nanoseconds
            frame = raw[16 : 16 + length - 1].decode()
            at = 4 + -(-(12 + length) // 4) * 4
        numbers = struct.unpack_from(f'{order}{layout.doubles}d', raw, at)
    except (struct.error, UnicodeDecodeError) as error:
        raise DecodeError(str(error)) from None
    if at + 8 * layout.doubles != len(raw):
        raise DecodeError(f'{len(raw)} bytes are no {message_type} in XCDR version 2')
    values = []
    for group in layout.columns:
        taken = numbers[group.first : group.first + group.count]
        silent = group.unreported >= 0 and numbers[group.unreported] == -1.0
        values.append(tuple(float('nan') for _ in taken) if silent else taken)
    return stamp, tuple(values), frame
