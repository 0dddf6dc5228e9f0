# SPDX-License-Identifier: Apache-2.0
"""Request and answer over a serial port, a pseudo-terminal or TCP."""

from __future__ import annotations

import termios
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import serial
from imu_recording.user_error import why_not_open

from chamber_profile.chambers.chamber import ChamberError

ANSWER_TIMEOUT_S = 3.0
"""Time a chamber may take to answer [s]."""


@dataclass
class Line:
    """One request, one answer. A failure closes the port; the next request opens it again.

    `port` is what `serial.serial_for_url` takes: a device path or `socket://HOST:PORT`.
    """

    port: str
    baudrate: int = 19200
    timeout_s: float = ANSWER_TIMEOUT_S
    pause_s: float = 0.0
    """Pause between an answer and the next request [s]."""
    _serial: serial.SerialBase | None = field(default=None, repr=False)

    def open(self) -> None:
        """Open the port; raise ChamberError where that fails."""
        self.close()
        options: Mapping[str, object] = {} if '://' in self.port else {'exclusive': True}
        try:
            self._serial = serial.serial_for_url(
                self.port, baudrate=self.baudrate, timeout=0.05, write_timeout=2.0, **options
            )
            self._drain()
        except (OSError, ValueError, termios.error) as error:
            self.close()
            raise ChamberError(why_not_open(self.port, error)) from error

    def close(self) -> None:
        """Close the port."""
        if self._serial is not None:
            self._serial.close()
            self._serial = None

    def ask(self, request: bytes, length: Callable[[bytes], int]) -> bytes:
        """Send a request and return its answer.

        `length(received)` is the length of the answer that begins with `received`; 0: unknown yet.
        """
        if self._serial is None:
            self.open()
        port = self._serial
        assert port is not None  # noqa: S101 (open sets it or raises)
        received = b''
        try:
            port.reset_input_buffer()
            port.write(request)
            deadline = time.monotonic() + self.timeout_s
            while not (size := length(received)) or len(received) < size:
                late = time.monotonic() - deadline
                # What has come in time is read, however busy this machine is.
                if late > 0.0 and (not port.in_waiting or late > self.timeout_s):
                    got = shown_bytes(received)
                    raise ChamberError(
                        f'{self.port}: no answer to {shown_bytes(request)}, got {got}'
                    )
                wanted = size - len(received) if size else port.in_waiting
                received += port.read(max(1, wanted))
        except (OSError, termios.error) as error:  # termios.error: the port vanished
            self.close()
            if isinstance(error, ChamberError):
                raise
            raise ChamberError(f'{self.port}: the link broke: {error}') from error
        if self.pause_s:
            time.sleep(self.pause_s)
        return received[:size]

    def ask_text(self, request: bytes, quiet_s: float = 0.2) -> bytes:
        """Send a request and return all that comes until nothing came for `quiet_s`."""
        return self.ask(request, _UntilQuiet(quiet_s))

    def _drain(self) -> None:
        """Discard late answers to earlier requests."""
        assert self._serial is not None  # noqa: S101 (called by open)
        for _ in range(20):
            if not self._serial.read(256):
                return


class _UntilQuiet:
    """Length function of answers that have ended once nothing came for `quiet_s`."""

    def __init__(self, quiet_s: float) -> None:
        self._quiet_s = quiet_s
        self._since, self._size = time.monotonic(), 0

    def __call__(self, received: bytes) -> int:
        if len(received) != self._size:
            self._since, self._size = time.monotonic(), len(received)
        return self._size if time.monotonic() - self._since > self._quiet_s else 0


def until(terminator: bytes) -> Callable[[bytes], int]:
    """Return the length function of answers that end with a terminator.

    >>> until(b'!')(b'ok!more'), until(b'!')(b'o')
    (3, 0)
    """
    return partial(_length_until, terminator)


def _length_until(terminator: bytes, received: bytes) -> int:
    place = received.find(terminator)
    return 0 if place < 0 else place + len(terminator)


def shown_bytes(data: bytes) -> str:
    """Return bytes as a message shows them: ASCII lines as text, others in hexadecimal.

    >>> shown_bytes(b'TEMP?'), shown_bytes(bytes([1, 3, 2])), shown_bytes(b'')
    ("b'TEMP?'", '01 03 02', 'nothing')
    """
    if not data:
        return 'nothing'
    is_text = all(32 <= byte < 127 for byte in data.rstrip(b'\r\n'))
    return repr(data) if is_text else data.hex(' ')
