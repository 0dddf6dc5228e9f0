# SPDX-License-Identifier: Apache-2.0
"""A topic that has gone quiet: whoever reads /diagnostics must not be told that all is well."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

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
