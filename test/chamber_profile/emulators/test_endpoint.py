# SPDX-License-Identifier: Apache-2.0
"""Endpoints answer, and lose the line under the fault disconnect and take it up after it."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from chamber_profile.emulators.endpoint import PtyEndpoint, TcpEndpoint
from imu_recording.user_error import UserError


class Counter:
    """Answers every piece of data with the number of bytes since it was made."""

    def __init__(self) -> None:
        self.received = 0

    def feed(self, data: bytes) -> list[bytes]:
        self.received += len(data)
        return [b'%d' % self.received]


def lost() -> set[str]:
    return {'disconnect'}


@pytest.fixture
def tcp() -> Iterator[TcpEndpoint]:
    endpoint = TcpEndpoint(0, Counter)
    yield endpoint
    endpoint.close()


def client_of(endpoint: TcpEndpoint) -> socket.socket:
    port = int(endpoint.name.rpartition(':')[2])
    client = socket.create_connection(('127.0.0.1', port), timeout=5.0)
    endpoint.serve(5.0, set)
    return client


def asked(endpoint: TcpEndpoint, client: socket.socket, data: bytes) -> bytes:
    client.sendall(data)
    endpoint.serve(5.0, set)
    return client.recv(100)


def test_every_client_has_a_server_of_its_own(tcp: TcpEndpoint) -> None:
    assert not tcp.contacted
    with client_of(tcp) as one, client_of(tcp) as other:
        assert asked(tcp, one, b'abc') == b'3'
        assert asked(tcp, other, b'ab') == b'2'
        assert asked(tcp, one, b'a') == b'4'
        tcp.send(b'to all')
        assert one.recv(100) == other.recv(100) == b'to all'
    assert tcp.contacted


def test_disconnect_drops_the_clients_and_refuses_others(tcp: TcpEndpoint) -> None:
    with client_of(tcp) as client:
        tcp.serve(0.0, lost)
        assert client.recv(100) == b''
    port = int(tcp.name.rpartition(':')[2])
    with socket.create_connection(('127.0.0.1', port), timeout=5.0) as refused:
        tcp.serve(5.0, lost)
        assert refused.recv(100) == b''
    with client_of(tcp) as again:
        assert asked(tcp, again, b'a') == b'1'


def test_a_port_beyond_all_is_refused() -> None:
    with pytest.raises(UserError, match='65536: expected a port'):
        TcpEndpoint(65536, Counter)


def test_a_terminal_is_unplugged_and_plugged_in_again(tmp_path: Path) -> None:
    link = tmp_path / 'line'
    link.symlink_to('/nowhere')  # left by a process that was killed
    endpoint = PtyEndpoint(link, Counter)
    for answer in (b'3', b'3'):  # the second time it is another server
        line = os.open(link, os.O_RDWR | os.O_NOCTTY)
        os.write(line, b'abc')
        endpoint.serve(5.0, set)
        assert os.read(line, 100) == answer
        endpoint.serve(0.0, lost)
        os.close(line)
        assert not link.is_symlink()
        endpoint.send(b'to nobody')
        endpoint.serve(0.0, lost)
        assert not link.is_symlink()
        endpoint.serve(0.0, set)
        assert link.is_symlink()
    endpoint.close()
    assert not link.is_symlink()
