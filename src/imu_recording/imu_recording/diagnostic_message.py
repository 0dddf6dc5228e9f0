# SPDX-License-Identifier: Apache-2.0
"""A node's status as the message that goes out on /diagnostics."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from imu_recording.messages import fill_stamp
from imu_recording.silence import Status


def diagnostic_array(name: str, stamp: int, status: Status) -> DiagnosticArray:
    """Return level, line and values of the node `name` at ROS time `stamp` [ns]."""
    level, line, values = status
    message = DiagnosticArray()
    message.status = [
        DiagnosticStatus(
            level=bytes([level]),
            name=name,
            message=line,
            hardware_id=str(values.get('device', '')),
            values=[KeyValue(key=str(k), value=_shown(v)) for k, v in values.items()],
        )
    ]
    fill_stamp(message.header.stamp, stamp)
    return message


def _shown(value: Any) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
