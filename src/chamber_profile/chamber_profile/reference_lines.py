# SPDX-License-Identifier: Apache-2.0
"""Lines of a data logger into temperatures by topic: one line per reading, a map of columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from imu_recording.user_error import UserError

LONGEST_LINE = 4096
"""More bytes without an end of line are not a line."""


class ColumnError(UserError):
    """A column map that maps nothing; the message says how one looks."""


def parse_columns(entries: Sequence[str]) -> dict[int, str]:
    """Return topic by column (0 …) of entries 'COLUMN=TOPIC'.

    >>> parse_columns(['1=chamber/temperature', '3=dut1/chamber/device_temperature'])
    {1: 'chamber/temperature', 3: 'dut1/chamber/device_temperature'}
    """
    columns: dict[int, str] = {}
    for entry in entries:
        number, separator, topic = entry.partition('=')
        if not (separator and number.strip().isdecimal() and topic.strip()):
            raise ColumnError(f'columns: {entry!r}, expected COLUMN=TOPIC, e.g. {_EXAMPLE}')
        if int(number) in columns or topic.strip() in columns.values():
            raise ColumnError(f'columns: {entry!r} is given twice')
        columns[int(number)] = topic.strip()
    if not columns:
        raise ColumnError(f'columns is empty, expected e.g. {_EXAMPLE}')
    return columns


_EXAMPLE = "'1=chamber/temperature'"


@dataclass
class ReferenceLines:
    """Feed it bytes as they come; it returns the temperatures of all whole lines.

    A field that is no number, or a temperature outside `plausible_c` (a broken sensor), is left
    out and counted; so is a line that has too few fields.
    """

    columns: dict[int, str]
    delimiter: str = ','
    plausible_c: tuple[float, float] = (-100.0, 300.0)
    lines: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    """What was left out, by topic."""
    _pending: bytes = b''
    _first: bool = True

    def feed(self, data: bytes) -> list[dict[str, float]]:
        """Return temperature [°C] by topic, one mapping per line."""
        *lines, self._pending = (self._pending + data).replace(b'\r', b'\n').split(b'\n')
        if len(self._pending) > LONGEST_LINE:
            self._pending = b''
        return [reading for line in lines if line.strip() and (reading := self._reading(line))]

    def _reading(self, line: bytes) -> dict[str, float]:
        fields = line.decode('ascii', 'replace').split(self.delimiter)
        first, self._first = self._first, False
        if first and len(fields) <= max(self.columns):
            return {}  # the line that was under way when the port was opened
        self.lines += 1
        reading = {}
        for column, topic in self.columns.items():
            value = _number(fields[column]) if column < len(fields) else math.nan
            if self.plausible_c[0] <= value <= self.plausible_c[1]:
                reading[topic] = value
            else:
                self.rejected[topic] = self.rejected.get(topic, 0) + 1
        return reading


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
