# SPDX-License-Identifier: Apache-2.0
"""A line over a real socket: answers in pieces, too late, or not at all."""

import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest
from chamber_profile.chambers.chamber import ChamberError
from chamber_profile.chambers.line import Line, until

Answer = Callable[[socket.socket, bytes], None]


@pytest.fixture
def connect() -> Iterator[Callable[[Answer], Line]]:
    """Make a line to a server that answers requests with a function."""
    listeners, threads = [], []

    def make(answer: Answer, timeout_s: float = 0.5) -> Line:
        listener = socket.create_server(('127.0.0.1', 0))

        def serve() -> None:
            while True:
                try:
                    client, _ = listener.accept()
                except OSError:
                    return
                with client:
                    while request := client.recv(100):
                        answer(client, request)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        listeners.append(listener)
        threads.append(thread)
        return Line(f'socket://127.0.0.1:{listener.getsockname()[1]}', timeout_s=timeout_s)

    yield make
    for listener in listeners:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()


def test_an_answer_in_pieces_is_put_together(connect) -> None:
    def answer(client: socket.socket, request: bytes) -> None:
        for piece in (b'2', b'3.', b'0\r', b'\n'):
            client.sendall(piece)
            time.sleep(0.02)

    line = connect(answer)
    assert line.ask(b'TEMP?', until(b'\r\n')) == b'23.0\r\n'
    line.close()


def test_no_answer_and_half_an_answer_are_named_with_what_came(connect) -> None:
    line = connect(lambda client, request: client.sendall(b'23.'), timeout_s=0.2)
    with pytest.raises(ChamberError, match=r"no answer to b'TEMP\?', got b'23\.'"):
        line.ask(b'TEMP?', until(b'\r\n'))


def test_an_answer_that_came_in_time_is_read_by_a_busy_machine(connect, monkeypatch) -> None:
    line = connect(lambda client, request: client.sendall(b'23.0\r\n'), timeout_s=0.2)
    now = iter([0.0, 0.1, *(0.3 + 0.01 * k for k in range(20))])
    line.open()
    monkeypatch.setattr('chamber_profile.chambers.line.time.monotonic', lambda: next(now))
    assert line.ask(b'TEMP?', until(b'\r\n')) == b'23.0\r\n'
    monkeypatch.undo()
    line.close()


def test_bytes_that_are_no_text_are_shown_in_hexadecimal(connect) -> None:
    line = connect(lambda client, request: None, timeout_s=0.1)
    with pytest.raises(ChamberError, match='no answer to 01 03 00 64, got nothing'):
        line.ask(bytes.fromhex('01 03 00 64'), len)


def test_a_late_answer_is_not_taken_for_the_next_one(connect) -> None:
    count = []

    def answer(client: socket.socket, request: bytes) -> None:
        count.append(request)
        if len(count) == 1:
            time.sleep(0.4)
        client.sendall(b'answer to ' + request + b'\r\n')

    line = connect(answer, timeout_s=0.2)
    with pytest.raises(ChamberError):
        line.ask(b'first', until(b'\r\n'))
    time.sleep(0.4)
    assert line.ask(b'second', until(b'\r\n')) == b'answer to second\r\n'
    line.close()


def test_text_is_read_until_the_line_is_quiet(connect) -> None:
    def answer(client: socket.socket, request: bytes) -> None:
        for piece in (b'CV01 Temperature\r', b'CV02 Humidity\r'):
            client.sendall(piece)
            time.sleep(0.05)

    line = connect(answer, timeout_s=2.0)
    assert line.ask_text(b'$01?\r') == b'CV01 Temperature\rCV02 Humidity\r'
    line.close()


def test_a_port_that_is_not_there_is_a_chamber_error_that_names_it() -> None:
    with pytest.raises(ChamberError, match='/dev/no_such_port'):
        Line('/dev/no_such_port').open()
