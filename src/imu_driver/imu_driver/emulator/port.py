# SPDX-License-Identifier: Apache-2.0
"""Ports of the emulated board: a pseudo-terminal under a stable name, or a TCP server."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import socket
import struct
import termios
import tty
from pathlib import Path
from typing import Protocol

_PEER_GONE_ERRORS = {errno.EIO, errno.EBADF, errno.EPIPE, errno.ECONNRESET}


class Port(Protocol):
    """The board's end of a line; it can be unplugged and plugged in again."""

    def plug(self) -> None:
        """Appear."""

    def pull(self) -> None:
        """Disappear; a reader at the other end gets an error."""

    def handles(self) -> list[int]:
        """Return the file descriptors to wait for input on."""

    def read(self) -> bytes:
        """Return the bytes the host sent."""

    def write(self, data: bytes) -> int:
        """Send without waiting; return how many bytes were taken."""

    @property
    def unread(self) -> int:
        """Bytes that the host has not read yet; 0 where that is unknown."""


class PtyPort:
    """A pseudo-terminal; `link` points to its device."""

    def __init__(self, link: Path) -> None:
        self._link = link
        self._board = self._host = -1

    def plug(self) -> None:
        """Make a terminal and the link to it."""
        if self._link.exists() and not self._link.is_symlink():
            raise FileExistsError(f'{self._link} exists and is no link; choose another name')
        self._board, self._host = os.openpty()
        # Held open and raw: nothing is echoed before a reader has set the terminal up itself.
        tty.setraw(self._host)
        os.set_blocking(self._board, False)
        fresh = self._link.with_name(f'{self._link.name}.{os.getpid()}')
        fresh.symlink_to(os.ttyname(self._host))
        fresh.replace(self._link)

    def pull(self) -> None:
        """Close the terminal and remove the link."""
        if self._board < 0:
            return
        if self._link.is_symlink() and str(self._link.readlink()) == os.ttyname(self._host):
            self._link.unlink()
        os.close(self._board)
        os.close(self._host)
        self._board = self._host = -1

    def handles(self) -> list[int]:
        """Return the board's side."""
        return [self._board] if self._board >= 0 else []

    def read(self) -> bytes:
        """Return the bytes the host sent."""
        return _read(self._board)

    def write(self, data: bytes) -> int:
        """Send as many bytes as the terminal takes."""
        return _write(self._board, data)

    @property
    def unread(self) -> int:
        """Bytes in the terminal's input queue."""
        if self._host < 0:
            return 0
        answer = fcntl.ioctl(self._host, termios.FIONREAD, struct.pack('i', 0))
        count: int = struct.unpack('i', answer)[0]
        return count


class TcpPort:
    """A TCP server on the local host for one client at a time."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._server: socket.socket | None = None
        self._client: socket.socket | None = None

    def plug(self) -> None:
        """Listen."""
        self._server = socket.create_server(('127.0.0.1', self._port))
        self._server.setblocking(False)

    def pull(self) -> None:
        """Close the connection and stop listening."""
        for end in (self._client, self._server):
            if end:
                end.close()
        self._client = self._server = None

    def handles(self) -> list[int]:
        """Return the client, or the server while there is none."""
        return [end.fileno() for end in (self._client or self._server,) if end]

    def read(self) -> bytes:
        """Return the bytes the client sent; accept a client where there is none."""
        if self._client is None:
            if self._server is not None:
                with contextlib.suppress(BlockingIOError):
                    self._client, _ = self._server.accept()
                    self._client.setblocking(False)
                    self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return b''
        with contextlib.suppress(BlockingIOError):
            try:
                data = self._client.recv(4096)
            except ConnectionError:
                data = b''
            if not data:
                self._client.close()
                self._client = None
            return data
        return b''

    def write(self, data: bytes) -> int:
        """Send as many bytes as the connection takes; without a client they are lost."""
        if self._client is None:
            return len(data)
        return _write(self._client.fileno(), data)

    @property
    def unread(self) -> int:
        """Not known for a connection."""
        return 0


def _read(handle: int) -> bytes:
    try:
        return os.read(handle, 4096) if handle >= 0 else b''
    except BlockingIOError:
        return b''
    except OSError as error:
        if error.errno in _PEER_GONE_ERRORS:
            return b''
        raise


def _write(handle: int, data: bytes) -> int:
    try:
        return os.write(handle, data) if handle >= 0 and data else 0
    except BlockingIOError:
        return 0
    except OSError as error:
        if error.errno in _PEER_GONE_ERRORS:
            return len(data)
        raise
