# SPDX-License-Identifier: Apache-2.0
"""The port of a data logger: opened when it is there, opened again when it comes back."""

from __future__ import annotations

import termios
import time

import serial
from imu_recording.port_error import why_not_open
from imu_recording.user_error import UserError

RETRY_S = 1.0


class ReferenceLoggerPort:
    """Reads what comes; a port that is missing or breaks is tried again every second."""

    def __init__(self, address: str, baudrate: int) -> None:
        scheme, _, rest = address.partition('://')
        if scheme not in ('serial', 'tcp') or not rest:
            raise UserError(f'port is {address!r}, expected serial:///dev/… or tcp://HOST:PORT')
        self.complaint = 'not opened yet'
        """What is wrong with the port; '' nothing."""
        self.reconnects = -1
        self._url = rest if scheme == 'serial' else f'socket://{rest}'
        self._baudrate = baudrate
        self._port: serial.SerialBase | None = None
        self._retry_at = 0.0

    def read(self) -> bytes:
        """Return what has come, b'' after a fifth of a second without anything."""
        try:
            if self._port is None:
                self._open()
            if self._port is None:
                return b''
            return bytes(self._port.read(1) + self._port.read(self._port.in_waiting))
        except (OSError, ValueError, termios.error) as error:
            self.complaint = why_not_open(self._url, error)
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
        self.complaint = ''
        self.reconnects += 1
