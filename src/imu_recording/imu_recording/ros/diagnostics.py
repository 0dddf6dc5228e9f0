# SPDX-License-Identifier: Apache-2.0
"""A node's status on /diagnostics, and the warning when its input has gone quiet."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from imu_recording.ros.messages import fill_stamp

QUIET_S = 10.0
"""A stream without a message for so long has ended or broken [s]."""

Status = tuple[int, str, dict[str, Any]]


class Silence:
    """Watches one stream of messages.

    >>> clock = iter([0.0, 4.0, 12.0])
    >>> silence = Silence(lambda: next(clock))
    >>> silence.listening(print)('a message')
    a message
    >>> silence.judged('imu/mag', (0, 'well', {})), silence.judged('imu/mag', (0, 'well', {}))
    ((0, 'well', {}), (1, 'no message on imu/mag for 12 s', {}))
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._heard_at = math.inf

    def listening(self, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return the callback, every call of which is noted."""

        def noted(message: Any) -> None:
            self._heard_at = self._now()
            callback(message)

        return noted

    def forget(self) -> None:
        """Begin anew: nothing has been heard, nothing is missed."""
        self._heard_at = math.inf

    def judged(self, topic: str, status: Status) -> Status:
        """Return a status, or a warning in its place where nothing is wrong but the silence."""
        silent = self._now() - self._heard_at
        if silent <= QUIET_S or status[0] > 1:
            return status
        return 1, f'no message on {topic} for {silent:.0f} s', status[2]


QUIET_S_STATUS_LOG = 60.0
"""A kind of status that comes and goes is logged once in so long [s]."""


class StatusLog:
    """Tells of each status whether to log it.

    >>> log = StatusLog()
    >>> log.is_news(0.0, 1, 'no line for 11 s'), log.is_news(1.0, 1, 'no line for 12 s')
    (True, False)
    >>> log.is_news(2.0, 0, 'reading'), log.is_news(3.0, 1, 'no line for 11 s')
    (True, False)
    """

    def __init__(self) -> None:
        self._last: tuple[int, str] | None = None
        self._logged: dict[tuple[int, str], float] = {}

    def is_news(self, time: float, level: int, line: str) -> bool:
        """Return whether the status at `time` [s] is of another kind than the one before."""
        kind = (level, re.sub(r'\d+(\.\d+)?', '#', line))
        if kind == self._last:
            return False
        self._last = kind
        if time - self._logged.get(kind, -math.inf) < QUIET_S_STATUS_LOG:
            return False
        self._logged[kind] = time
        return True


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
