# SPDX-License-Identifier: Apache-2.0
"""Decode one message at a time through rosbags, where the compiled kernels know no layout."""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)
from rosbags.typesys.store import Typestore

from imu_recording.bags.cdr import LAYOUTS, NANOSECONDS
from imu_recording.logging_contract import STRING

Values = tuple[tuple[float, ...], ...]

_VALUES: dict[str, Any] = {
    'sensor_msgs/msg/Imu': lambda m: (
        _vector(m.angular_velocity, m.angular_velocity_covariance),
        _vector(m.linear_acceleration, m.linear_acceleration_covariance),
    ),
    'sensor_msgs/msg/MagneticField': lambda m: (_vector(m.magnetic_field),),
    'sensor_msgs/msg/Temperature': lambda m: ((m.temperature,),),
    'sensor_msgs/msg/RelativeHumidity': lambda m: ((m.relative_humidity,),),
    'geometry_msgs/msg/Vector3Stamped': lambda m: (_vector(m.vector),),
    'geometry_msgs/msg/QuaternionStamped': lambda m: (
        (m.quaternion.x, m.quaternion.y, m.quaternion.z, m.quaternion.w),
    ),
    'std_msgs/msg/Float64': lambda m: ((m.data,),),
}


_FOREIGN = (IndexError, AttributeError, TypeError, ValueError, KeyError)
"""What a message of another definition under the same name raises."""


class OddMessageError(ValueError):
    """A message whose bytes are not a message of its type."""


@cache
def standard_types() -> Typestore:
    """Return the message types of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


@cache
def types_of(message_type: str, definition: str) -> Typestore:
    """Return the types to decode a topic by: the bag's own definition where it differs."""
    standard = standard_types()
    if not definition:
        return standard
    try:
        own = get_typestore(Stores.EMPTY)
        own.register(_parsed(message_type, definition))
        own.get_msgdef(message_type)
    except (TypesysError, LookupError, ValueError, AttributeError, TypeError) as error:
        kind = type(error).__name__
        raise OddMessageError(f'definition of {message_type} is damaged ({kind})') from None
    if own.hash_rihs01(message_type) == standard.hash_rihs01(message_type):
        return standard
    return own


@cache
def definition_of(message_type: str) -> str:
    """Return the text of a standard type's definition, '' for a type that is not standard."""
    types = standard_types()
    if message_type not in types.fielddefs:
        return ''
    return str(types.generate_msgdef(message_type, ros_version=2)[0])


@cache
def hash_of(message_type: str) -> str:
    """Return the RIHS01 hash of a standard type, '' for a type that is not standard."""
    types = standard_types()
    return str(types.hash_rihs01(message_type)) if message_type in types.fielddefs else ''


def _parsed(message_type: str, definition: str) -> Any:
    separator = '=' * 80 + '\n'
    if not definition.startswith(f'{separator}IDL: '):
        return get_types_from_msg(definition, message_type)
    types: dict[str, Any] = {}
    for part in definition.split(separator)[1:]:
        types.update(get_types_from_idl(part.split('\n', 1)[1]))
    return types


def decode_odd(raw: bytes, message_type: str, types: Typestore) -> tuple[int | None, Values, str]:
    """Return stamp [ns] (None without header), column groups and frame_id of one message."""
    if raw[:2] in (b'\x00\x06', b'\x00\x07') and message_type in LAYOUTS:
        return _decode_version_2(raw, message_type)
    try:
        message: Any = types.deserialize_cdr(raw, message_type)
        return values_of(message, message_type)
    except (SerdeError, TypesysError, struct.error, *_FOREIGN) as error:
        raise OddMessageError(str(error)) from None


def values_of(message: Any, message_type: str) -> tuple[int | None, Values, str]:
    """Return stamp, column groups and frame_id of a rosbags message object."""
    if message_type == STRING:
        return None, (), str(message.data)
    values: Values = _VALUES[message_type](message)
    if not LAYOUTS[message_type].stamped:
        return None, values, ''
    stamp = message.header.stamp
    return stamp.sec * NANOSECONDS + stamp.nanosec, values, message.header.frame_id


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
            stamp = seconds * NANOSECONDS + nanoseconds
            frame = raw[16 : 16 + length - 1].decode()
            at = 4 + -(-(12 + length) // 4) * 4
        numbers = struct.unpack_from(f'{order}{layout.doubles}d', raw, at)
    except (struct.error, UnicodeDecodeError) as error:
        raise OddMessageError(str(error)) from None
    if at + 8 * layout.doubles != len(raw):
        raise OddMessageError(f'{len(raw)} bytes are no {message_type} in XCDR version 2')
    values = []
    for group in layout.columns:
        taken = numbers[group.first : group.first + group.count]
        silent = group.unreported >= 0 and numbers[group.unreported] == -1.0
        values.append(tuple(float('nan') for _ in taken) if silent else taken)
    return stamp, tuple(values), frame
