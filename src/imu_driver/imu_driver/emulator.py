# SPDX-License-Identifier: Apache-2.0
"""The emulated board on its plug, with faults on schedule; `step` does what is due."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Final

from imu_driver.emulated_board import EmulatedBoard
from imu_driver.emulator_port import Port
from imu_driver.faults import FaultSchedule
from imu_driver.faulty_line import FaultyLine

LOG_EVERY: Final = 1.0
"""[s]."""
PATIENCE: Final = 0.02
"""[s] between looks at the schedule."""
TRICKLE_STEP: Final = 0.001
"""[s]."""
EXCHANGE: Final = 0.2
"""[s] the line is open while one board takes another's place."""
OTHER: Final = '-OTHER'
"""Appended to the serial number of the board that takes the place."""
SLOW: Final = 0.7
"""Actual over nominal rate under wrong_rate."""


class Emulator:
    """Runs a board on a port; times are seconds since `start`."""

    def __init__(
        self,
        board: EmulatedBoard,
        port: Port,
        schedule: FaultSchedule | None = None,
        *,
        now: Callable[[], float],
        log: Path | None = None,
    ) -> None:
        self.board = board
        self.line = FaultyLine(board.options.protocol)
        self._port = port
        self._schedule = schedule or FaultSchedule()
        self._now = now
        self._start = now()
        self._log = log
        self._next_log = 0.0
        self._faults: frozenset[str] = frozenset()
        self._unsent = b''
        self._plugged = False
        self._replug_at = 0.0
        self._serial_number = board.options.serial_number
        self._full_scale = 0.0

    def handles(self) -> list[int]:
        """Return what to wait for input on."""
        return self._port.handles() if self._plugged else []

    def step(self) -> float:
        """Do what is due; return how long nothing will be [s]."""
        time = self._now() - self._start
        faults = self._schedule.active(time)
        if faults != self._faults:
            self._change(faults, time)
        self._set_plug(time)
        if self._plugged and 'reset' not in faults:
            self.board.receive(self._port.read(), time)
        frames = [] if 'reset' in faults else self.board.advance(time)
        line_faults = faults if self._plugged else faults | {'unplug'}
        self.board.overruns += self.line.put(frames, line_faults)
        if self._plugged:
            data = self._unsent + self.line.take(time, faults)
            self._unsent = data[self._port.write(data) :]
        if self._log and time >= self._next_log:
            self.write_log()
            self._next_log = time + LOG_EVERY
        if 'trickle' in faults:
            return TRICKLE_STEP
        due = self.board.next_due - (self._now() - self._start)
        return PATIENCE if 'reset' in faults else min(max(due, 0.0), PATIENCE)

    def finish(self) -> None:
        """Say how many samples there were and send what waits, as far as it is taken."""
        time = self._now() - self._start
        self.board.streaming = False
        if self._plugged:
            self.line.put([self.board.farewell(time)], frozenset())
            data = self._unsent + self.line.take(time, frozenset())
            self._port.write(data)

    @property
    def unread(self) -> int:
        """Bytes the host has not read yet."""
        return self._port.unread if self._plugged else 0

    def close(self) -> None:
        """Leave."""
        if self._plugged:
            self._port.pull()
            self._plugged = False

    def write_log(self) -> None:
        """Rewrite the log."""
        if self._log:
            text = json.dumps(self.line.log(self._schedule.faults, self._now() - self._start))
            fresh = self._log.with_name(f'{self._log.name}.part')
            fresh.write_text(f'{text}\n', encoding='utf-8')
            fresh.replace(self._log)

    def _set_plug(self, time: float) -> None:
        wanted = 'unplug' not in self._faults and time >= self._replug_at
        if wanted and not self._plugged:
            self._port.plug()
        if self._plugged and not wanted:
            self._port.pull()
            self._unsent = b''
            self.line.cut()
        self._plugged = wanted

    def _change(self, faults: frozenset[str], time: float) -> None:
        began, ended = faults - self._faults, self._faults - faults
        self._faults = faults
        self.board.rate_error = SLOW if 'wrong_rate' in faults else 1.0
        if 'reset' in began:
            self.line.cut()
            self._unsent = b''
        if 'reset' in ended:
            self.board.restart(time)
        if 'wrong_scale' in began:
            self._full_scale = self.board.full_scale['accelerometer']
            self.board.set_full_scale('accelerometer', 8.0 if self._full_scale != 8.0 else 2.0)
        if 'wrong_scale' in ended and self.board.full_scale['accelerometer'] != self._full_scale:
            self.board.set_full_scale('accelerometer', self._full_scale)
        if 'other_serial' in began:
            self._exchange(self._serial_number[: 16 - len(OTHER)] + OTHER, time)
        if 'other_serial' in ended:
            self._exchange(self._serial_number, time)

    def _exchange(self, serial_number: str, time: float) -> None:
        self._replug_at = time + EXCHANGE
        self._set_plug(time)
        self.board.restart(self._replug_at, serial_number)
