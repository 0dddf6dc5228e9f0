# SPDX-License-Identifier: Apache-2.0
"""`ros2 run imu_driver emulated_device`: a board of flesh and wire, without either."""

from __future__ import annotations

import argparse
import select
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Final

from imu_recording.recording import UP_AXES
from imu_recording.user_error import UserError

from imu_driver.emulated_board import BoardOptions
from imu_driver.emulator import Emulator
from imu_driver.emulator_port import Port, PtyPort, TcpPort
from imu_driver.faults import DEFAULT_DURATION, FAULTS, FaultSchedule, parse_fault
from imu_driver.transport_simulated import DEFAULT_RATE, emulated_board

DRAIN: Final = 0.5
"""[s] the host gets to read what was sent before the end."""


def arguments() -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    faults = '; '.join(f'{name}: {text}' for name, text in FAULTS.items())
    parser = argparse.ArgumentParser(
        prog='emulated_device',
        description='An IMU board that speaks the wire protocol (doc/wire_protocol.md).',
        epilog=f'Faults last {DEFAULT_DURATION:g} s unless told otherwise. {faults}.',
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
        help='temperature of the surroundings over time, columns time_s,temperature_c '
        '(as "plan --csv" writes), or one number [°C]',
    )
    parser.add_argument('--rate', type=float, default=DEFAULT_RATE, metavar='HZ')
    parser.add_argument(
        '--time-scale',
        type=float,
        default=1.0,
        metavar='X',
        help='temperatures run X times faster; samples keep their rate',
    )
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--log', type=Path, metavar='FILE', help='what was sent and damaged, JSON')
    parser.add_argument(
        '--fault', action='append', default=[], metavar='NAME@SECONDS[+DURATION]', dest='faults'
    )
    parser.add_argument(
        '--minimal',
        action='store_true',
        help='send data from power-on and understand nothing, as a first sketch does',
    )
    parser.add_argument('--version-byte', type=int, default=1, help='protocol version to claim')
    return parser


def build(options: argparse.Namespace) -> Emulator:
    """Return the emulator the options describe; raise ValueError naming what is wrong."""
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
        temperature=options.temperature,
        orientation=options.orientation,
        seed=options.seed,
        time_scale=options.time_scale,
    )
    port: Port = PtyPort(options.link) if options.link else TcpPort(options.tcp)
    return Emulator(board, port, schedule, now=time.monotonic, log=options.log)


def run(emulator: Emulator, stop: threading.Event) -> None:
    """Run until `stop` is set; then let the host read what was sent."""
    try:
        while not stop.is_set():
            wait = emulator.step()
            select.select(emulator.handles(), [], [], wait)
        emulator.finish()
        deadline = time.monotonic() + DRAIN
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
