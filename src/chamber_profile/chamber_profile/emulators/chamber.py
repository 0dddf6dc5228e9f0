# SPDX-License-Identifier: Apache-2.0
"""An emulated chamber on a TCP port or a pseudo-terminal: physics, protocol and faults."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from functools import partial

from imu_recording.user_error import UserError

from chamber_profile.emulators.endpoint import (
    Server,
    add_endpoint_arguments,
    caught_signals,
    open_endpoint,
)
from chamber_profile.emulators.espec import EspecServer
from chamber_profile.emulators.faults import FAULTS, FaultPlan, parse_fault
from chamber_profile.emulators.plant import EmulatedPlant
from chamber_profile.emulators.votsch import Ascii2Server, SimservServer
from chamber_profile.emulators.watlow_f4 import WatlowF4Server

CLOCK_PERIOD_S = 0.02
"""Longest time between two advances of the chamber's clock [s]."""

SERVERS: dict[str, Callable[[EmulatedPlant, int, bool], Server]] = {
    'espec': lambda plant, address, _: EspecServer(plant, address),
    'ascii2': lambda plant, address, _: Ascii2Server(plant, address or 1),
    'simserv': lambda plant, address, _: SimservServer(plant, address or 1),
    'watlow_f4': lambda plant, address, tcp: WatlowF4Server(plant, address or 1, tcp=tcp),
}
"""Protocol → server of a plant, an address (0: none given) and whether it is on TCP."""


def build_parser() -> argparse.ArgumentParser:
    """Return the command line."""
    parser = argparse.ArgumentParser(
        prog='emulated_chamber',
        description='Emulate a climatic chamber: its protocol, its physics, its faults.',
        epilog='Faults, in seconds of the host since the first contact, until the end unless '
        '+DURATION is given: ' + '; '.join(f'{name}: {what}' for name, what in FAULTS.items()),
    )
    parser.add_argument('--protocol', choices=sorted(SERVERS), default='espec')
    add_endpoint_arguments(parser)
    parser.add_argument('--address', type=int, default=0, help='address on a bus')
    parser.add_argument(
        '--time-scale', metavar='X', type=float, default=1.0, help='chamber seconds per second'
    )
    parser.add_argument('--seed', type=int, default=0, help='of sensor errors and noise')
    parser.add_argument(
        '--fault', metavar='NAME@SECONDS[+DURATION]', action='append', default=[], dest='faults'
    )
    return parser


class EmulatedChamber:
    """A plant, its faults and the endpoint of its protocol, on the clock of the host."""

    def __init__(self, options: argparse.Namespace) -> None:
        faults = [parse_fault(text) for text in options.faults]
        if not options.time_scale > 0.0:
            raise UserError(f'--time-scale {options.time_scale:g}: expected a positive number')
        plant = EmulatedPlant(options.seed, options.time_scale)
        make_server = partial(
            SERVERS[options.protocol], plant, options.address, options.tcp is not None
        )
        self.endpoint = open_endpoint(options, make_server)
        self._plant = plant
        self._faults = FaultPlan(faults, plant)
        plant.advance_to(0.0)
        plant.chamber.advance(1.0)  # the physics is compiled before the first request
        self._began = time.monotonic()
        self._first_contact: float | None = None

    def serve(self) -> None:
        """Serve requests for CLOCK_PERIOD_S."""
        self.endpoint.serve(CLOCK_PERIOD_S, self._active_faults)

    def _active_faults(self) -> set[str]:
        """Advance the plant to now and return its active faults, timed from the first contact."""
        now = time.monotonic() - self._began
        self._plant.advance_to(now)
        if self.endpoint.contacted and self._first_contact is None:
            self._first_contact = now
        since = -math.inf if self._first_contact is None else now - self._first_contact
        return self._faults.active_at(since)


def main(argv: list[str] | None = None) -> int:
    """Serve until interrupted; return the process's exit code."""
    if argv is None:
        argv = sys.argv[1:]
        if '--ros-args' in argv:
            argv = argv[: argv.index('--ros-args')]
    options = build_parser().parse_args(argv)
    interrupted = caught_signals()
    try:
        chamber = EmulatedChamber(options)
    except (ValueError, OSError) as error:
        sys.stderr.write(f'emulated_chamber: {error}\n')
        return 2
    sys.stdout.write(f'{options.protocol} at {chamber.endpoint.name}\n')
    sys.stdout.flush()
    try:
        while not interrupted:
            chamber.serve()
    finally:
        chamber.endpoint.close()
    return 0


if __name__ == '__main__':
    sys.exit(main())
