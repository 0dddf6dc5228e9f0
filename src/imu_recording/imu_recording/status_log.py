# SPDX-License-Identifier: Apache-2.0
"""Which lines of /diagnostics are news for a log: a change of kind, not of a figure."""

from __future__ import annotations

import math
import re

QUIET_S = 60.0
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
        if time - self._logged.get(kind, -math.inf) < QUIET_S:
            return False
        self._logged[kind] = time
        return True
