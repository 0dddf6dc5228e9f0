# SPDX-License-Identifier: Apache-2.0
"""Messages of one burst leave together, in order, and none stays behind."""

from __future__ import annotations

import threading
from types import TracebackType

import pytest
from imu_recording.ros.exchange import Outbox


class Handle:
    """Stands in for the handle of a publisher."""

    def __init__(self, sent: list[bytes]) -> None:
        self._sent = sent

    def __enter__(self) -> None:
        pass

    def __exit__(
        self, kind: type[BaseException] | None, error: object, trace: TracebackType | None
    ) -> None:
        pass

    def publish_raw(self, data: bytes) -> None:
        if data == b'refused':
            raise ValueError(data)
        self._sent.append(data)


def test_messages_leave_at_once_or_together_at_the_end_of_a_burst() -> None:
    outbox, sent = Outbox(), list[bytes]()
    first, second = Handle(sent), Handle(sent)
    outbox.put(first, b'0')
    assert sent == [b'0']
    with outbox:
        outbox.put(first, b'1')
        outbox.put(second, b'2')
        outbox.put(first, b'3')
        assert sent == [b'0']
    assert sent == [b'0', b'1', b'2', b'3']


def test_a_burst_that_fails_still_sends_what_it_made() -> None:
    outbox, sent = Outbox(), list[bytes]()

    def burst() -> None:
        with outbox:
            outbox.put(Handle(sent), b'1')
            raise KeyError

    with pytest.raises(KeyError):
        burst()
    outbox.put(Handle(sent), b'2')
    assert sent == [b'1', b'2']


def test_a_message_that_is_refused_holds_none_back() -> None:
    outbox, sent = Outbox(), list[bytes]()

    def burst() -> None:
        with outbox:
            outbox.put(Handle(sent), b'refused')
            outbox.put(Handle(sent), b'1')

    with pytest.raises(ValueError, match='refused'):
        burst()
    outbox.put(Handle(sent), b'2')
    assert sent == [b'1', b'2']


def test_what_another_thread_sends_meanwhile_is_sent_once_and_in_order() -> None:
    outbox, sent = Outbox(), list[bytes]()
    handle = Handle(sent)
    numbers = [str(k).encode() for k in range(2000)]

    def send() -> None:
        for number in numbers:
            outbox.put(handle, number)

    other = threading.Thread(target=send)
    other.start()
    while other.is_alive():
        with outbox:
            outbox.put(handle, b'burst')
    other.join()
    assert [data for data in sent if data != b'burst'] == numbers
