# SPDX-License-Identifier: Apache-2.0
"""Where the bytes come from: serial:///dev/…, tcp://host:port, simulated://dut1.

A transport reads what is there, at the latest after TIMEOUT; it raises OSError once the other
side is gone. Opening it again is the caller's business.
"""

from __future__ import annotations

import contextlib
import select
import socket
import termios
from collections.abc import Callable
from typing import Final, Protocol
from urllib.parse import urlsplit

import serial
from imu_recording.user_error import UserError, why_not_open

TIMEOUT: Final = 0.05
"""[s] A read returns at the latest after this, with nothing if nothing came."""
CONNECT_WITHIN: Final = 1.0
"""[s]."""


class TransportError(UserError):
    """A transport that cannot exist; the message names it and the forms there are."""


class Transport(Protocol):
    """An open line."""

    def read(self) -> bytes:
        """Return what has come, b'' after TIMEOUT; raise OSError where the line is gone."""

    def write(self, data: bytes) -> None:
        """Send; raise OSError where the line is gone."""

    def close(self) -> None:
        """Release the line; never raises."""


class SerialTransport:
    """A serial port, held exclusively."""

    def __init__(self, path: str, baudrate: int) -> None:
        try:
            self._port = serial.Serial(
                path, baudrate, timeout=TIMEOUT, write_timeout=TIMEOUT, exclusive=True
            )
        except (OSError, ValueError, termios.error) as error:  # or no such baud rate, or gone
            raise OSError(why_not_open(path, error)) from None

    def read(self) -> bytes:
        """Return what has come."""
        first: bytes = self._port.read(1)
        waiting = self._port.in_waiting if first else 0
        return first + self._port.read(waiting) if waiting else first

    def write(self, data: bytes) -> None:
        """Send."""
        # A device that takes nothing for a while is asked again by the caller, not gone.
        with contextlib.suppress(serial.SerialTimeoutException):
            self._port.write(data)

    def close(self) -> None:
        """Release the port."""
        with contextlib.suppress(OSError):
            self._port.close()


class TcpTransport:
    """A serial line behind a TCP socket (serial server, Wi-Fi board, emulator)."""

    def __init__(self, host: str, port: int) -> None:
        try:
            self._socket = socket.create_connection((host, port), timeout=CONNECT_WITHIN)
        except OSError as error:
            raise OSError(why_not_open(f'{host}:{port}', error)) from None
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(TIMEOUT)

    def read(self) -> bytes:
        """Return what has come."""
        if not select.select([self._socket], [], [], TIMEOUT)[0]:
            return b''
        chunk = self._socket.recv(65536)
        if not chunk:
            raise ConnectionError('the other side closed the connection')
        return chunk

    def write(self, data: bytes) -> None:
        """Send."""
        self._socket.sendall(data)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def transport_opener(url: str, baudrate: int, rate: float = 0.0) -> Callable[[], Transport]:
    """Return a function that opens the transport; raise TransportError where none can be.

    `rate` [Hz] is what a simulated device samples at from power-on.
    """
    parts = urlsplit(url)
    path = parts.netloc + parts.path
    if parts.scheme == 'serial' and path:
        return lambda: SerialTransport(path, baudrate)
    if parts.scheme == 'tcp':
        try:
            host, port = parts.hostname, parts.port
        except ValueError:
            host, port = None, None
        if host and port:
            return lambda: TcpTransport(host, port)
    if parts.scheme == 'simulated' and parts.netloc:
        from imu_driver.emulator.transport import SimulatedTransport  # only now: slow to import

        transport = SimulatedTransport.from_url(url, rate)
        return lambda: transport
    raise TransportError(
        f'transport {url!r}: expected serial:///dev/serial/by-id/NAME, tcp://HOST:PORT, '
        'simulated://dut1 or bag://PATH'
    )
