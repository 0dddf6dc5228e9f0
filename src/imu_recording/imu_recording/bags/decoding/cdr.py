# SPDX-License-Identifier: Apache-2.0
"""Where the numbers stand in a serialised message (CDR, little endian, XCDR version 1).

4 bytes encapsulation 00 01 00 00; alignment counts from byte 4. With a header: sec int32 at 4,
nanosec uint32 at 8, length of frame_id with its NUL uint32 at 12, characters at 16; the doubles
start at 4 + ceil8(12 + len(frame_id) + 1). OMG DDS-XTypes 1.3, 7.4.1; confirmed against rclpy and
rosbags for frame_id lengths 0 to 23.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imu_recording.logging_contract import (
    FLOAT,
    HUMIDITY,
    IMU,
    MAGNETIC_FIELD,
    PRESSURE,
    QUATERNION,
    TEMPERATURE,
    VECTOR,
)
from imu_recording.recording import SECOND_NS

Bytes = NDArray[np.uint8]

ENCAPSULATION = b'\x00\x01\x00\x00'
"""First bytes of a message: plain CDR, little endian, without options."""
LITTLE_ENDIAN = ENCAPSULATION[:2]
"""The representation identifier alone; the two bytes of options may differ."""


@dataclass(frozen=True)
class Columns:
    """A group of consecutive doubles."""

    first: int
    """Index of the first among the message's doubles."""
    count: int
    unreported: int = -1
    """Index of the double that is −1 where the group is not reported (REP-145); −1: none."""


@dataclass(frozen=True)
class Layout:
    """Layout of a message type that is an optional header followed by doubles."""

    stamped: bool
    doubles: int
    columns: tuple[Columns, ...]

    def body(self, frame_length: int) -> int:
        """Return the byte at which the doubles start; `frame_length` without NUL."""
        return 4 + -(-(12 + frame_length + 1) // 8) * 8 if self.stamped else 4

    def size(self, frame_length: int) -> int:
        """Return the length of a message in bytes.

        >>> [LAYOUTS[name].size(8) for name in (IMU, MAGNETIC_FIELD, TEMPERATURE)]
        [324, 124, 44]
        """
        return self.body(frame_length) + 8 * self.doubles


LAYOUTS: dict[str, Layout] = {
    IMU: Layout(True, 37, (Columns(13, 3, 16), Columns(25, 3, 28))),
    MAGNETIC_FIELD: Layout(True, 12, (Columns(0, 3),)),
    TEMPERATURE: Layout(True, 2, (Columns(0, 1),)),
    HUMIDITY: Layout(True, 2, (Columns(0, 1),)),
    PRESSURE: Layout(True, 2, (Columns(0, 1),)),
    VECTOR: Layout(True, 3, (Columns(0, 3),)),
    QUATERNION: Layout(True, 4, (Columns(0, 4),)),
    FLOAT: Layout(False, 1, (Columns(0, 1),)),
}


def encode_messages(
    message_type: str,
    stamp: NDArray[np.int64],
    frame_id: str,
    columns: tuple[NDArray[np.float64], ...],
    constants: dict[int, float] | None = None,
) -> Bytes:
    """Return n serialised messages as (n, size) bytes; unused doubles and padding are zero.

    `columns` are the layout's groups, each (n, count); `constants` sets further doubles.
    """
    layout = LAYOUTS[message_type]
    frame = frame_id.encode()
    body = layout.body(len(frame))
    records = np.zeros((len(stamp), layout.size(len(frame))), np.uint8)
    records[:, 1] = 1
    if layout.stamped:
        seconds, nanoseconds = np.divmod(stamp, SECOND_NS)
        records[:, 4:8] = _little_endian(seconds, '<i4')
        records[:, 8:12] = _little_endian(nanoseconds, '<u4')
        text = len(frame) + 1
        records[:, 12:16] = np.frombuffer(text.to_bytes(4, 'little'), np.uint8)
        records[:, 16 : 16 + len(frame)] = np.frombuffer(frame, np.uint8)
    for index, value in (constants or {}).items():
        at = body + 8 * index
        records[:, at : at + 8] = np.frombuffer(np.array([value], '<f8').tobytes(), np.uint8)
    for group, values in zip(layout.columns, columns, strict=True):
        at = body + 8 * group.first
        taken = np.ascontiguousarray(values, dtype='<f8').reshape(len(stamp), group.count)
        records[:, at : at + 8 * group.count] = taken.view(np.uint8)
    return records


def _little_endian(values: NDArray[np.int64], kind: str) -> Bytes:
    return values.astype(kind).reshape(-1, 1).view(np.uint8)
