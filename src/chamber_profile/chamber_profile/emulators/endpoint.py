# SPDX-License-Identifier: Apache-2.0
"""Endpoints of an emulator: a TCP port, or a pseudo-terminal behind a symbolic link."""

from __future__ import annotations

import argparse
import contextlib
import os
import selectors
import signal
import socket
import termios
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, TypeAlias

from imu_recording.user_error import UserError

from chamber_profile.emulators.faults import damaged


class Server(Protocol):
    """The chamber's side of a protocol."""

    def feed(self, data: bytes) -> list[bytes]:
        """Take received bytes; return the answers to all whole requests."""


class TcpEndpoint:
    """A TCP port of this machine; every client has a server of its own."""

    def __init__(self, port: int, make_server: Callable[[], Server]) -> None:
        self.contacted = False
        """Whether a client has connected."""
        self._make_server = make_server
        self._selector = selectors.DefaultSelector()
        if not 0 <= port <= 65535:
            raise UserError(f'--tcp {port}: expected a port, 1 … 65535, or 0 for any')
        self._listener = socket.create_server(('127.0.0.1', port))
        self._listener.setblocking(False)
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._clients: dict[socket.socket, Server] = {}
        self.name = f'tcp://127.0.0.1:{self._listener.getsockname()[1]}'

    def serve(self, timeout_s: float, prepare: Callable[[], set[str]]) -> None:
        """Serve requests for at most `timeout_s`; `prepare` returns the active faults."""
        ready = self._selector.select(timeout_s)
        self.contacted |= bool(ready)
        active = prepare()
        if 'disconnect' in active:
            for client in list(self._clients):
                self._drop(client)
        for key, _ in ready:
            if key.fileobj is self._listener:
                self._accept(refuse='disconnect' in active)
            elif key.fileobj in self._clients:
                self._answer(key.fileobj, active)

    def send(self, data: bytes) -> None:
        """Send to every client."""
        for client in list(self._clients):
            try:
                client.sendall(data)
            except OSError:
                self._drop(client)

    def close(self) -> None:
        """Stop listening and drop all clients."""
        for client in list(self._clients):
            self._drop(client)
        self._listener.close()
        self._selector.close()

    def _accept(self, *, refuse: bool) -> None:
        client, _ = self._listener.accept()
        if refuse:
            client.close()
            return
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._clients[client] = self._make_server()
        self._selector.register(client, selectors.EVENT_READ)

    def _answer(self, client: socket.socket, active: set[str]) -> None:
        try:
            data = client.recv(4096)
            for answer in self._clients[client].feed(data):
                client.sendall(damaged(answer, active))
        except OSError:
            data = b''
        if not data:
            self._drop(client)

    def _drop(self, client: socket.socket) -> None:
        self._selector.unregister(client)
        del self._clients[client]
        client.close()


class PtyEndpoint:
    """A pseudo-terminal; `link` becomes a symbolic link to it."""

    def __init__(self, link: Path, make_server: Callable[[], Server]) -> None:
        self.link = link
        self.contacted = False
        """Whether anything was received."""
        self.name = f'serial://{link.absolute()}'
        self._make_server = make_server
        self._master = self._slave = -1
        self._open()

    def serve(self, timeout_s: float, prepare: Callable[[], set[str]]) -> None:
        """Serve requests for at most `timeout_s`; `prepare` returns the active faults."""
        if self._master < 0:
            if 'disconnect' not in prepare():
                self._open()
            return
        with selectors.DefaultSelector() as selector:
            selector.register(self._master, selectors.EVENT_READ)
            ready = selector.select(timeout_s)
        self.contacted |= bool(ready)
        active = prepare()
        if 'disconnect' in active:
            self.close()
        elif ready:
            for answer in self._server.feed(os.read(self._master, 4096)):
                self.send(damaged(answer, active))

    def send(self, data: bytes) -> None:
        """Send; what does not fit because nobody reads is lost, as on a wire."""
        if self._master >= 0:
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, data)

    def close(self) -> None:
        """Remove the link and close the terminal."""
        if self._master >= 0:
            self.link.unlink(missing_ok=True)
            os.close(self._master)
            os.close(self._slave)
            self._master = -1

    def _open(self) -> None:
        # The slave stays open here: without it the master fails with EIO between two clients.
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave, termios.TCSANOW)
        os.set_blocking(self._master, False)
        with contextlib.suppress(FileNotFoundError):
            self.link.unlink()
        self.link.symlink_to(os.ttyname(self._slave))
        self._server = self._make_server()


Endpoint: TypeAlias = TcpEndpoint | PtyEndpoint


def add_endpoint_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that choose an endpoint: --tcp or --link."""
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument('--tcp', metavar='PORT', type=int, help='listen on this port; 0: any')
    where.add_argument('--link', metavar='PATH', type=Path, help='link to a pseudo-terminal')


def open_endpoint(options: argparse.Namespace, make_server: Callable[[], Server]) -> Endpoint:
    """Return the endpoint the options choose."""
    if options.link is None:
        return TcpEndpoint(options.tcp, make_server)
    return PtyEndpoint(options.link, make_server)


def caught_signals() -> list[int]:
    """Return a list to which SIGINT and SIGTERM are appended instead of ending the process."""
    caught: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda signum, _: caught.append(signum))
    return caught
