# SPDX-License-Identifier: Apache-2.0
"""`ros2 run imu_driver emulated_device`: an emulated board on a pseudo-terminal or TCP port."""

from __future__ import annotations

import argparse
import json
import select
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from imu_recording.recording import UP_AXES
from imu_recording.user_error import UserError

from imu_driver.emulator.board import BoardOptions, EmulatedBoard
from imu_driver.emulator.faults import (
    DEFAULT_DURATION_S,
    FAULTS,
    FaultSchedule,
    FaultyLine,
    parse_fault,
)
from imu_driver.emulator.port import Port, PtyPort, TcpPort
from imu_driver.emulator.transport import DEFAULT_RATE_HZ, ambient_law, emulated_board

LOG_INTERVAL_S: Final = 1.0
"""[s] between writes of the log."""
LONGEST_WAIT_S: Final = 0.02
"""[s] Longest time between steps, and so the largest delay of a scheduled fault."""
TRICKLE_WAIT_S: Final = 0.001
"""[s] between steps under the fault trickle."""
EXCHANGE_TIME_S: Final = 0.2
"""[s] for which the line is unplugged while the board is exchanged for another."""
OTHER_BOARD_SUFFIX: Final = '-OTHER'
"""Suffix of the other board's serial number."""
WRONG_RATE_RATIO: Final = 0.7
"""Actual over nominal rate under wrong_rate."""


class Emulator:
    """A board on a port, with faults on a schedule; times are seconds since the start."""

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
        """Return the file descriptors to wait for input on."""
        return self._port.handles() if self._plugged else []

    def step(self) -> float:
        """Do what is due; return the time [s] until something may be due again."""
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
            self._next_log = time + LOG_INTERVAL_S
        if 'trickle' in faults:
            return TRICKLE_WAIT_S
        due = self.board.next_due - (self._now() - self._start)
        return LONGEST_WAIT_S if 'reset' in faults else min(max(due, 0.0), LONGEST_WAIT_S)

    def finish(self) -> None:
        """Stop the stream, send the final information and as much of the buffer as is taken."""
        time = self._now() - self._start
        self.board.streaming = False
        if self._plugged:
            self.line.put([self.board.final_information(time)], frozenset())
            data = self._unsent + self.line.take(time, frozenset())
            self._port.write(data)

    @property
    def unread(self) -> int:
        """Bytes the host has not read yet."""
        return self._port.unread if self._plugged else 0

    def close(self) -> None:
        """Unplug the board."""
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
        self.board.rate_error = WRONG_RATE_RATIO if 'wrong_rate' in faults else 1.0
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
            self._exchange(
                self._serial_number[: 16 - len(OTHER_BOARD_SUFFIX)] + OTHER_BOARD_SUFFIX, time
            )
        if 'other_serial' in ended:
            self._exchange(self._serial_number, time)

    def _exchange(self, serial_number: str, time: float) -> None:
        self._replug_at = time + EXCHANGE_TIME_S
        self._set_plug(time)
        self.board.restart(self._replug_at, serial_number)


DRAIN_TIMEOUT_S: Final = 0.5
"""[s] for the host to read the last bytes before the end."""


def arguments() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    faults = '; '.join(f'{name}: {text}' for name, text in FAULTS.items())
    parser = argparse.ArgumentParser(
        prog='emulated_device',
        description='An IMU board that speaks the wire protocol (doc/wire_protocol.md).',
        epilog=f'Faults last {DEFAULT_DURATION_S:g} s unless given otherwise. {faults}.',
    )
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument('--link', type=Path, metavar='PATH', help='pseudo-terminal under this name')
    where.add_argument('--tcp', type=int, metavar='PORT', help='TCP server on the local host')
    parser.add_argument('--protocol', choices=('binary', 'ascii'), default='binary')
    parser.add_argument('--dut', default='dut1', help='simulated device (dut1, dut2, dut3)')
    parser.add_argument('--serial', help='serial number; default: the device in capitals')
    parser.add_argument('--orientation', choices=UP_AXES, default='+z', help='axis that points up')
    parser.add_argument(
        '--temperature',
        default='20',
        metavar='CSV',
        help='ambient temperature over time, columns time_s,temperature_c '
        '(as "plan --csv" writes), or one number [°C]',
    )
    parser.add_argument('--rate', type=float, default=DEFAULT_RATE_HZ, metavar='HZ')
    parser.add_argument(
        '--time-scale',
        type=float,
        default=1.0,
        metavar='X',
        help='temperatures run X times faster; samples keep their rate',
    )
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument(
        '--log',
        type=Path,
        metavar='FILE',
        help='counts of samples sent, dropped and damaged, JSON',
    )
    parser.add_argument(
        '--fault', action='append', default=[], metavar='NAME@SECONDS[+DURATION]', dest='faults'
    )
    parser.add_argument(
        '--minimal',
        action='store_true',
        help='send data from power-on and take no commands, as a first sketch does',
    )
    parser.add_argument('--version-byte', type=int, default=1, help='protocol version to claim')
    return parser


def build(options: argparse.Namespace) -> Emulator:
    """Return the emulator of the options; raise UserError naming a wrong one."""
    schedule = FaultSchedule([parse_fault(text) for text in options.faults])
    if not (options.rate > 0 and options.time_scale > 0):
        raise UserError('--rate and --time-scale must be above 0')
    if options.tcp is not None and not 0 < options.tcp < 65536:
        raise UserError(f'--tcp {options.tcp}: expected a port, 1 … 65535')
    if options.minimal and options.protocol != 'ascii':
        raise UserError('--minimal speaks ASCII: add --protocol ascii')
    board = emulated_board(
        options.dut,
        BoardOptions(
            protocol=options.protocol,
            serial_number=options.serial or options.dut.upper(),
            output_data_rate=options.rate,
            first_tick=schedule.first_tick(),
            minimal=options.minimal,
            version=options.version_byte,
        ),
        ambient=ambient_law(options.temperature),
        orientation=options.orientation,
        seed=options.seed,
        time_scale=options.time_scale,
    )
    port: Port = PtyPort(options.link) if options.link else TcpPort(options.tcp)
    return Emulator(board, port, schedule, now=time.monotonic, log=options.log)


def run(emulator: Emulator, stop: threading.Event) -> None:
    """Run until `stop` is set; then let the host read the last bytes."""
    try:
        while not stop.is_set():
            wait = emulator.step()
            select.select(emulator.handles(), [], [], wait)
        emulator.finish()
        deadline = time.monotonic() + DRAIN_TIMEOUT_S
        while emulator.unread and time.monotonic() < deadline:
            time.sleep(0.01)
    finally:
        emulator.write_log()
        emulator.close()


def main(argv: list[str] | None = None) -> int:
    """Emulate a board until SIGTERM or Ctrl-C."""
    options = arguments().parse_args(argv)
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    try:
        run(build(options), stop)
    except (ValueError, OSError) as error:
        print(f'emulated_device: {error}', file=sys.stderr)  # noqa: T201 (command line)
        return 2
    return 0
