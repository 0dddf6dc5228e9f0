# SPDX-License-Identifier: Apache-2.0
"""Serialised messages of a device whose motion is known, and a clock that is set by hand."""

from collections.abc import Sequence

import numpy as np
from imu_recording.bags.decoding.cdr import encode_messages
from imu_recording.logging_contract import IMU
from imu_recording.recording import SECOND_NS
from imu_recording.ros.message_cdr import serialise
from imu_workbench.web.live.state import LiveState
from sensor_msgs.msg import Imu

START = 1_800_000_000 * SECOND_NS
GRAVITY = np.array([0.1, -0.2, 9.8])
TRUE_RATE = np.array([0.01, -0.02, 0.005])


class Clock:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.time = 100.0

    def __call__(self) -> float:
        return self.time


def stamps(seconds: float, rate_hz: float, begin_s: float = 0.0) -> np.ndarray:
    """Return stamps [ns] at a rate, from `begin_s` after START."""
    count = round(seconds * rate_hz)
    return (
        START
        + round(begin_s * SECOND_NS)
        + (np.arange(count) * SECOND_NS / rate_hz).astype(np.int64)
    )


def imu(stamp: np.ndarray, rate: np.ndarray, force: np.ndarray, frame: str = 'imu') -> list[bytes]:
    """Return serialised Imu messages without an orientation."""
    shape = (len(stamp), 3)
    columns = (np.broadcast_to(rate, shape), np.broadcast_to(force, shape))
    return [row.tobytes() for row in encode_messages(IMU, stamp, frame, columns, {4: -1.0})]


def oriented(stamp: np.ndarray, quaternion: Sequence[np.ndarray]) -> list[bytes]:
    """Return serialised Imu messages with the orientations alone."""
    messages = []
    for one, xyzw in zip(stamp, quaternion, strict=True):
        message = Imu()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(int(one), SECOND_NS)
        o = message.orientation
        o.x, o.y, o.z, o.w = (float(part) for part in xyzw)
        messages.append(serialise(message))
    return messages


def put(state: LiveState, role: str, messages: Sequence[bytes]) -> None:
    """Give the state messages of a role."""
    for message in messages:
        state.put(role, message)
