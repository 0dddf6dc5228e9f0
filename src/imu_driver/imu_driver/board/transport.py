# SPDX-License-Identifier: Apache-2.0
"""Lines to a board: a serial port, or a TCP connection that carries the same bytes.

A transport reads what is there, at the latest after READ_TIMEOUT_S; it raises OSError once the
other side is gone. Opening it again is the caller's business.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import termios
from collections.abc import Collection
from typing import Final, Protocol
from urllib.parse import parse_qsl, urlsplit

import serial
from imu_recording.user_error import UserError, why_not_open

READ_TIMEOUT_S: Final = 0.05
"""[s] A read returns at the latest after this, with nothing if nothing came."""
LONGEST_READ_BYTES: Final = 65536
"""[bytes]."""
CONNECT_TIMEOUT_S: Final = 1.0
"""[s] A TCP connection that takes longer fails."""


def url_options(url: str, known: Collection[str]) -> dict[str, str]:
    """Return the options of an address, `?name=value&…`; UserError names one that is not known.

    >>> url_options('simulated://dut1?orientation=+x', ['orientation', 'seed'])
    {'orientation': '+x'}
    """
    # A plus sign is a sign here, not a space.
    options = dict(parse_qsl(urlsplit(url).query.replace('+', '%2B')))
    unknown = sorted(options.keys() - set(known))
    if unknown:
        raise UserError(f'{url}: unknown option {unknown[0]}; known: {", ".join(known)}')
    return options


class Transport(Protocol):
    """An open line."""

    def read(self) -> bytes:
        """Return the bytes received, b'' after READ_TIMEOUT_S; OSError where the line is gone."""

    def write(self, data: bytes) -> None:
        """Send; raise OSError where the line is gone."""

    def close(self) -> None:
        """Release the line; never raises."""


class SerialTransport:
    """A serial port, held exclusively."""

    def __init__(self, path: str, baudrate: int) -> None:
        try:
            self._port = serial.Serial(
                path,
                baudrate,
                timeout=READ_TIMEOUT_S,
                write_timeout=READ_TIMEOUT_S,
                exclusive=True,
            )
        except (OSError, ValueError, termios.error) as error:  # or no such baud rate, or gone
            raise OSError(why_not_open(path, error)) from None

    def read(self) -> bytes:
        """Return the bytes received."""
        port = self._port.fileno()  # two calls of the system; pyserial needs five for as much
        if not select.select([port], [], [], READ_TIMEOUT_S)[0]:
            return b''
        chunk = os.read(port, LONGEST_READ_BYTES)
        if not chunk:
            raise ConnectionError('the port is ready and has nothing: the device is gone')
        return chunk

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
            self._socket = socket.create_connection((host, port), timeout=CONNECT_TIMEOUT_S)
        except OSError as error:
            raise OSError(why_not_open(f'{host}:{port}', error)) from None
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(READ_TIMEOUT_S)

    def read(self) -> bytes:
        """Return the bytes received."""
        if not select.select([self._socket], [], [], READ_TIMEOUT_S)[0]:
            return b''
        chunk = self._socket.recv(LONGEST_READ_BYTES)
        if not chunk:
            raise ConnectionError('the other side closed the connection')
        return chunk

    def write(self, data: bytes) -> None:
        """Send."""
        self._socket.sendall(data)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
