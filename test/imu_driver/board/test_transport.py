# SPDX-License-Identifier: Apache-2.0
"""Lines to a board: bytes both ways, and an OSError that names the line once it is gone."""

import os
import socket
import tty
from pathlib import Path

import pytest
from imu_driver.board.transport import SerialTransport, TcpTransport, Transport


def exchange(transport: Transport) -> bytes:
    """Read until something came."""
    while not (chunk := transport.read()):
        pass
    return chunk


def test_a_serial_line(tmp_path: Path) -> None:
    board, host = os.openpty()
    tty.setraw(host)
    transport = SerialTransport(os.ttyname(host), 921600)
    os.write(board, b'data')
    assert exchange(transport) == b'data'
    assert transport.read() == b''
    transport.write(b'command')
    assert os.read(board, 100) == b'command'
    transport.close()
    os.close(board)
    os.close(host)
    with pytest.raises(OSError, match='imu7'):
        SerialTransport(str(tmp_path / 'imu7'), 921600)


def test_a_tcp_connection() -> None:
    with socket.create_server(('127.0.0.1', 0)) as server:
        port = server.getsockname()[1]
        transport = TcpTransport('127.0.0.1', port)
        board, _ = server.accept()
        board.sendall(b'data')
        assert exchange(transport) == b'data'
        assert transport.read() == b''
        transport.write(b'command')
        assert board.recv(100) == b'command'
        board.close()
        with pytest.raises(ConnectionError, match='closed the connection'):
            exchange(transport)
        transport.close()
    with pytest.raises(OSError, match=f'127.0.0.1:{port}'):
        TcpTransport('127.0.0.1', port)
