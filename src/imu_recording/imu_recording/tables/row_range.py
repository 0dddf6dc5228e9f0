# SPDX-License-Identifier: Apache-2.0
"""A part of a file: from one line or time to another."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imu_recording.recording import IntArray
from imu_recording.tables.mapping import TIME_UNITS
from imu_recording.user_error import UserError


@dataclass(frozen=True)
class RowRange:
    """Lines of a file, and times since its first sample; None where there is no limit."""

    first_line: int | None = None
    """Counted from 1, the header included: as editors and messages count."""
    last_line: int | None = None
    start: int | None = None
    """[ns]."""
    end: int | None = None

    @property
    def by_line(self) -> bool:
        """True where a line is a limit."""
        return self.first_line is not None or self.last_line is not None

    def has_line(self, number: int) -> bool:
        """Tell whether a line of the file is inside."""
        return (self.first_line is None or number >= self.first_line) and (
            self.last_line is None or number <= self.last_line
        )

    def within(self, stamp: IntArray) -> NDArray[np.bool_]:
        """Return which of (n,) increasing stamps [ns] are inside, counted from the first."""
        since = stamp - stamp[0] if len(stamp) else stamp
        inside = np.ones(len(stamp), bool)
        if self.start is not None:
            inside &= since >= self.start
        if self.end is not None:
            inside &= since <= self.end
        return inside


def row_range(first: str | None, last: str | None) -> RowRange:
    """Return the range of two limits: a line of the file (1200), or a time (90s, 5min, 2h).

    >>> row_range('5min', None)
    RowRange(first_line=None, last_line=None, start=300000000000, end=None)
    """
    first_line, start = _limit('--from', first)
    last_line, end = _limit('--to', last)
    for low, high in ((first_line, last_line), (start, end)):
        if low is not None and high is not None and low > high:
            raise UserError(f'--from {first} --to {last}: the beginning is after the end')
    return RowRange(first_line=first_line, last_line=last_line, start=start, end=end)


def _limit(name: str, text: str | None) -> tuple[int | None, int | None]:
    """Return line or time [ns]."""
    if text is None:
        return None, None
    match = re.fullmatch(r'(\d+(?:\.\d+)?)\s*([a-zµ]*)', text.strip())
    if match and not match[2] and '.' not in match[1]:
        return int(match[1]), None
    if match and match[2] in TIME_UNITS:
        return None, round(float(match[1]) * TIME_UNITS[match[2]])
    raise UserError(
        f'{name} {text}: expected a line of the file (1200), or a time since its first sample '
        f'with a unit ({", ".join(TIME_UNITS)})'
    )
