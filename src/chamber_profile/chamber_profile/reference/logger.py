# SPDX-License-Identifier: Apache-2.0
"""A data logger: its port, and its lines of temperatures by topic."""

from __future__ import annotations

import math
import termios
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import serial
from imu_recording.user_error import UserError, why_not_open

MAX_LINE_BYTES = 4096
"""Longest line; more bytes without an end of line are dropped."""


class ColumnError(UserError):
    """A column map that is not one; the message gives an example."""


def parse_columns(entries: Sequence[str]) -> dict[int, str]:
    """Return topic by column (0 …) of entries 'COLUMN=TOPIC'.

    >>> parse_columns(['1=chamber/temperature', '3=dut1/chamber/device_temperature'])
    {1: 'chamber/temperature', 3: 'dut1/chamber/device_temperature'}
    """
    columns: dict[int, str] = {}
    for entry in entries:
        number, separator, topic = entry.partition('=')
        if not (separator and number.strip().isdecimal() and topic.strip()):
            raise ColumnError(
                f'columns: {entry!r}, expected COLUMN=TOPIC, e.g. {_EXAMPLE_MAPPING}'
            )
        if int(number) in columns or topic.strip() in columns.values():
            raise ColumnError(f'columns: {entry!r} is given twice')
        columns[int(number)] = topic.strip()
    if not columns:
        raise ColumnError(f'columns is empty, expected e.g. {_EXAMPLE_MAPPING}')
    return columns


_EXAMPLE_MAPPING = "'1=chamber/temperature'"


@dataclass
class ReferenceLines:
    """Parses received bytes into temperatures, line by line.

    A field that is missing, not a number or outside `plausible_c` (a broken sensor) is left out
    and counted.
    """

    columns: dict[int, str]
    delimiter: str = ','
    plausible_c: tuple[float, float] = (-100.0, 300.0)
    lines: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    """Number of fields left out, by topic."""
    _pending: bytes = b''
    _first: bool = True

    def feed(self, data: bytes) -> list[dict[str, float]]:
        """Return temperature [°C] by topic, one mapping per line."""
        *lines, self._pending = (self._pending + data).replace(b'\r', b'\n').split(b'\n')
        if len(self._pending) > MAX_LINE_BYTES:
            self._pending = b''
        return [reading for line in lines if line.strip() and (reading := self._reading(line))]

    def _reading(self, line: bytes) -> dict[str, float]:
        fields = line.decode('ascii', 'replace').split(self.delimiter)
        first, self._first = self._first, False
        if first and len(fields) <= max(self.columns):
            return {}  # the line that was being sent when the port was opened
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


RETRY_S = 1.0
"""Time between two tries to open the port [s]."""


class ReferenceLoggerPort:
    """Reads a port; one that is missing or breaks is opened again every second."""

    def __init__(self, address: str, baudrate: int) -> None:
        scheme, _, rest = address.partition('://')
        if scheme not in ('serial', 'tcp') or not rest:
            raise UserError(f'port is {address!r}, expected serial:///dev/… or tcp://HOST:PORT')
        self.fault = 'not opened yet'
        """Fault of the port; '' none."""
        self.reconnects = -1
        self._url = rest if scheme == 'serial' else f'socket://{rest}'
        self._baudrate = baudrate
        self._port: serial.SerialBase | None = None
        self._retry_at = 0.0

    def read(self) -> bytes:
        """Return the bytes received, b'' after 0.2 s without any."""
        try:
            if self._port is None:
                self._open()
            if self._port is None:
                return b''
            return bytes(self._port.read(1) + self._port.read(self._port.in_waiting))
        except (OSError, ValueError, termios.error) as error:
            self.fault = why_not_open(self._url, error)
            self.close()
            self._retry_at = time.monotonic() + RETRY_S
            return b''

    def close(self) -> None:
        """Release the port."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def _open(self) -> None:
        if time.monotonic() < self._retry_at:
            time.sleep(0.1)
            return
        options = {} if '://' in self._url else {'exclusive': True}
        self._port = serial.serial_for_url(
            self._url, baudrate=self._baudrate, timeout=0.2, **options
        )
        self.fault = ''
        self.reconnects += 1
