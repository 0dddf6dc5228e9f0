# SPDX-License-Identifier: Apache-2.0
"""An emulated chamber on a TCP port or a pseudo-terminal: physics, protocol and faults."""

from __future__ import annotations

import argparse
import math
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType

from imu_recording.user_error import UserError

from chamber_profile.emulators.endpoint import PtyEndpoint, Server, TcpEndpoint
from chamber_profile.emulators.espec import EspecServer
from chamber_profile.emulators.faults import FAULTS, FaultPlan, parse_fault
from chamber_profile.emulators.plant import EmulatedPlant
from chamber_profile.emulators.votsch import Ascii2Server, SimservServer
from chamber_profile.emulators.watlow_f4 import WatlowF4Server

LOOK_S = 0.02
"""The chamber's clock moves at least so often [s]."""

SERVERS: dict[str, Callable[[EmulatedPlant, int, bool], Server]] = {
    'espec': lambda body, address, _: EspecServer(body, address),
    'ascii2': lambda body, address, _: Ascii2Server(body, address or 1),
    'simserv': lambda body, address, _: SimservServer(body, address or 1),
    'watlow_f4': lambda body, address, tcp: WatlowF4Server(body, address or 1, tcp=tcp),
}
"""Protocol → server of a body, an address (0: none given) and whether it is on TCP."""


def build_parser() -> argparse.ArgumentParser:
    """Return the command line."""
    parser = argparse.ArgumentParser(
        prog='emulated_chamber',
        description='Emulate a climatic chamber: its protocol, its physics, its faults.',
        epilog='Faults, in seconds of the host since the first contact, until the end unless '
        '+DURATION is given: ' + '; '.join(f'{name}: {what}' for name, what in FAULTS.items()),
    )
    parser.add_argument('--protocol', choices=sorted(SERVERS), default='espec')
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument('--tcp', metavar='PORT', type=int, help='listen on this port; 0: any')
    where.add_argument('--link', metavar='PATH', type=Path, help='link to a pseudo-terminal')
    parser.add_argument('--address', type=int, default=0, help='address on a bus')
    parser.add_argument(
        '--time-scale', metavar='X', type=float, default=1.0, help='chamber seconds per second'
    )
    parser.add_argument('--seed', type=int, default=0, help='of sensor errors and noise')
    parser.add_argument(
        '--fault', metavar='NAME@SECONDS[+DURATION]', action='append', default=[], dest='faults'
    )
    return parser


def open_endpoint(options: argparse.Namespace, body: EmulatedPlant) -> TcpEndpoint | PtyEndpoint:
    """Return the port or terminal the options ask for."""
    tcp = options.tcp is not None

    def make_server() -> Server:
        return SERVERS[options.protocol](body, options.address, tcp)

    return TcpEndpoint(options.tcp, make_server) if tcp else PtyEndpoint(options.link, make_server)


def main(argv: list[str] | None = None) -> int:
    """Serve until interrupted; return the process's exit code."""
    if argv is None:
        argv = sys.argv[1:]
        if '--ros-args' in argv:
            argv = argv[: argv.index('--ros-args')]
    options = build_parser().parse_args(argv)
    stopped: list[int] = []

    def stop(number: int, _: FrameType | None) -> None:
        stopped.append(number)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    try:
        faults = [parse_fault(text) for text in options.faults]
        if not options.time_scale > 0.0:
            raise UserError(f'--time-scale {options.time_scale:g}: expected a positive number')
        body = EmulatedPlant(options.seed, options.time_scale)
        endpoint = open_endpoint(options, body)
    except (ValueError, OSError) as error:
        sys.stderr.write(f'emulated_chamber: {error}\n')
        return 2
    body.look(0.0)
    body.chamber.advance(1.0)  # compiled before the first request
    sys.stdout.write(f'{options.protocol} at {endpoint.name}\n')
    sys.stdout.flush()
    plan, began = FaultPlan(faults, body), time.monotonic()
    met: list[float] = []

    def prepare() -> set[str]:
        now = time.monotonic() - began
        body.look(now)
        if endpoint.contacted and not met:
            met.append(now)
        return plan.look(now - met[0] if met else -math.inf)

    try:
        while not stopped:
            endpoint.serve(LOOK_S, prepare)
    finally:
        endpoint.close()
    return 0


if __name__ == '__main__':
    sys.exit(main())
