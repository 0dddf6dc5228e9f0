# SPDX-License-Identifier: Apache-2.0
"""A node's status: on /diagnostics, in the log, and as a warning when its input has stopped."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from imu_recording.ros.messages import fill_stamp

INPUT_TIMEOUT_S = 10.0
"""Time without a message from which an input has ended or broken [s]."""
FIRST_INPUT_S = 5.0
"""Time after activation from which a node reports that it has received nothing [s]."""
LOG_REPEAT_S = 60.0
"""Shortest time between two log entries of a status that comes and goes [s]."""

NO_HARDWARE = 'none'
"""hardware_id of a task that no hardware is known of, as diagnostic_updater has it."""

Status = tuple[int, str, dict[str, Any]]
"""Level (0 ok, 1 warn, 2 error), one line, values."""


class InputTimeout:
    """Turns the status of a node into a warning while its input has no messages.

    >>> clock = iter([0.0, 4.0, 12.0])
    >>> timeout = InputTimeout(lambda: next(clock))
    >>> timeout.heard()
    >>> timeout.applied('imu/mag', (0, 'ok', {})), timeout.applied('imu/mag', (0, 'ok', {}))
    ((0, 'ok', {}), (1, 'no message on imu/mag for 12 s', {}))
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._received_at = math.inf
        self._started_at = math.inf

    @property
    def is_overdue(self) -> bool:
        """Whether no message has come since the restart, FIRST_INPUT_S ago and more."""
        never = math.isinf(self._received_at)
        return never and self._now() - self._started_at > FIRST_INPUT_S

    def heard(self) -> None:
        """Take note that a message came."""
        self._received_at = self._now()

    def restart(self) -> None:
        """Wait for a first message."""
        self._received_at = math.inf
        self._started_at = self._now()

    def applied(self, topic: str, status: Status) -> Status:
        """Return the status; in place of one that is no error a warning after the timeout."""
        quiet_s = self._now() - self._received_at
        if quiet_s <= INPUT_TIMEOUT_S or status[0] > 1:
            return status
        return 1, f'no message on {topic} for {quiet_s:.0f} s', status[2]


class StatusLog:
    """Tells of each status whether it is new: another level or text, not only another figure.

    >>> log = StatusLog()
    >>> log.is_new(0.0, 1, 'no line for 11 s'), log.is_new(1.0, 1, 'no line for 12 s')
    (True, False)
    >>> log.is_new(2.0, 0, 'reading'), log.is_new(3.0, 1, 'no line for 11 s')
    (True, False)
    """

    def __init__(self) -> None:
        self._last: tuple[int, str] | None = None
        self._logged: dict[tuple[int, str], float] = {}

    def is_new(self, time: float, level: int, line: str) -> bool:
        """Return whether the status at `time` [s] is to be logged."""
        kind = (level, re.sub(r'\d+(\.\d+)?', '#', line))
        if kind == self._last:
            return False
        self._last = kind
        if time - self._logged.get(kind, -math.inf) < LOG_REPEAT_S:
            return False
        self._logged[kind] = time
        return True


def diagnostic_array(
    name: str, stamp: int, tasks: Mapping[str, Status], hardware: str = NO_HARDWARE
) -> DiagnosticArray:
    """Return the status of each task of the node `name` at ROS time `stamp` [ns].

    Names are `node: task`, as those of diagnostic_updater; the hardware's is the `device` among
    the values of a task, else `hardware`.
    """
    devices = [str(v['device']) for _, _, v in tasks.values() if v.get('device')]
    message = DiagnosticArray()
    message.status = [
        DiagnosticStatus(
            level=bytes([level]),
            name=f'{name}: {task}',
            message=line,
            hardware_id=devices[0] if devices else hardware,
            values=[KeyValue(key=str(k), value=_shown(v)) for k, v in values.items()],
        )
        for task, (level, line, values) in tasks.items()
    ]
    fill_stamp(message.header.stamp, stamp)
    return message


def node_of(status_name: str) -> str:
    """Return the node a status is of, without its task.

    >>> node_of('dut1/imu_driver: stream'), node_of('/some_driver')
    ('dut1/imu_driver', 'some_driver')
    """
    return status_name.partition(':')[0].strip().lstrip('/')


def _shown(value: Any) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
