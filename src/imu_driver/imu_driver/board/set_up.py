# SPDX-License-Identifier: Apache-2.0
"""Set-up of a connected device: one command at a time, acknowledged or repeated."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Final

from imu_recording.recording import SECOND_NS

from imu_driver.board.lsm9ds1 import SENSORS
from imu_driver.wire.codec import encode
from imu_driver.wire.frames import (
    AcknowledgementFrame,
    CommandCode,
    CommandFrame,
    InformationFrame,
    Status,
)

ACKNOWLEDGEMENT_TIMEOUT_NS: Final = 300_000_000
"""[ns] after which an unacknowledged command is sent again."""
INFORMATION_INTERVAL_NS: Final = 500_000_000
"""[ns] between requests for information while the device is unknown."""
MOST_TRIES: Final = 5
RETRY_PAUSE_NS: Final = 2 * SECOND_NS
"""[ns] after an unanswered command before the set-up is tried again."""

FULL_SCALE_COMMANDS: Final = dict(
    zip(
        SENSORS,
        (
            CommandCode.GYROSCOPE_FULL_SCALE,
            CommandCode.ACCELEROMETER_FULL_SCALE,
            CommandCode.MAGNETOMETER_FULL_SCALE,
        ),
        strict=True,
    )
)


class DeviceSetUp:
    """Commands that bring one connected device to the full scales and the rate wanted."""

    def __init__(self, full_scale: Mapping[str, float], output_data_rate: float, now: int) -> None:
        self._full_scale = full_scale
        self._output_data_rate = output_data_rate
        self._queue: deque[tuple[CommandCode, int]] = deque()
        self._pending: CommandFrame | None = None
        self._tries = 0
        self._number = 0
        self._due = now
        self._ask_at = now
        self._asked = True
        self._retry_at = 0
        self._gave_up = False
        self.refused: dict[int, str] = {}
        """Commands the device did not carry out, by command code, with its answer."""

    def informed(self, frame: InformationFrame, now: int) -> None:
        """Queue commands for every setting of the device that is not the one wanted."""
        if self._pending or self._queue or now < self._retry_at:
            return
        for sensor, current in zip(SENSORS, frame.full_scale, strict=True):
            wanted = self._full_scale.get(sensor, 0.0)
            if wanted and wanted != current:
                self.request(FULL_SCALE_COMMANDS[sensor], round(wanted))
        wanted = round(self._output_data_rate * 1e3)
        if wanted and wanted != frame.output_data_rate:
            self.request(CommandCode.OUTPUT_DATA_RATE, wanted)
        if not frame.streaming:
            self.request(CommandCode.START)

    def request(self, code: CommandCode, value: int = 0) -> None:
        """Queue a command, unless the device has said that it cannot do it."""
        if code not in self.refused:
            self._queue.append((code, value))

    def ask(self, now: int) -> None:
        """Ask for information, at most every INFORMATION_INTERVAL_NS."""
        self._asked = True
        self._ask_at = min(self._ask_at, now + INFORMATION_INTERVAL_NS)

    def stopped(self) -> None:
        """The device restarted: drop every command under way."""
        self._queue.clear()
        self._pending = None
        self._asked = True
        self._ask_at = 0

    def give_up(self) -> None:
        """The device takes no commands: send nothing more."""
        self._gave_up = True

    def acknowledged(self, frame: AcknowledgementFrame) -> str:
        """Take an answer; return a sentence where the device did not do as asked, else ''."""
        pending = self._pending
        if pending is None or pending.number != frame.number:
            return ''
        self._pending = None
        if frame.status == Status.DONE:
            self.refused.pop(frame.command, None)
            return ''
        name = CommandCode(pending.command).name.lower().replace('_', ' ')
        answer = _ANSWERS.get(frame.status, f'status {frame.status}')
        sentence = f'the device did not set {name} to {pending.value}: {answer}'
        self.refused[pending.command] = sentence
        return sentence

    def outgoing(self, now: int, protocol: str, *, known: bool) -> bytes:
        """Return the bytes due now. `known`: whether the device has reported its full scales."""
        if self._gave_up:
            return b''
        if now >= self._ask_at and (self._asked or not known):
            self._asked = False
            self._ask_at = now + INFORMATION_INTERVAL_NS
            return self._encoded(CommandFrame(CommandCode.INFORMATION, 0), protocol)
        if self._pending is not None:
            if now < self._due:
                return b''
            if self._tries >= MOST_TRIES:
                self._pending = None
                self._retry_at = now + RETRY_PAUSE_NS
                return b''
        elif self._queue and protocol != 'auto':
            code, value = self._queue.popleft()
            self._number = self._number % 255 + 1
            self._pending = CommandFrame(code, self._number, value)
            self._tries = 0
        if self._pending is None:
            return b''
        self._tries += 1
        self._due = now + ACKNOWLEDGEMENT_TIMEOUT_NS
        return self._encoded(self._pending, protocol)

    @staticmethod
    def _encoded(command: CommandFrame, protocol: str) -> bytes:
        # The leading zero or line end completes a damaged frame in the device's buffer. While its
        # protocol is unknown the command goes out in both.
        binary = b'\0' + encode(command, 'binary')
        text = b'\n' + encode(command, 'ascii')
        return {'binary': binary, 'ascii': text}.get(protocol, binary + text)


_ANSWERS: Final[dict[int, str]] = {
    Status.UNKNOWN_COMMAND: 'it does not know the command',
    Status.BAD_VALUE: 'it does not have that value',
    Status.DEVICE_ERROR: 'its sensor did not answer',
}
