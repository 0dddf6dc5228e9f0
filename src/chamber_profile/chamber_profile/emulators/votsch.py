# SPDX-License-Identifier: Apache-2.0
"""A Weiss/Vötsch chamber's answers in SIMPAC ASCII-2 and in SIMSERV."""

from __future__ import annotations

from collections.abc import Callable

from chamber_profile.chambers.chamber import ChamberRefusalError
from chamber_profile.chambers.votsch import SEPARATOR
from chamber_profile.emulators.plant import EmulatedPlant

SET_VALUES = 7
START_BIT = 1


class Ascii2Server:
    """Requests `$01I`, `$01E …`, `$01U …`, `$01?`, each ended by CR."""

    def __init__(self, plant: EmulatedPlant, address: int = 1) -> None:
        self._plant = plant
        self._prefix = f'${address:02d}'
        self._pending = b''
        self._set = [0.0] * SET_VALUES
        self._bits = '0' * 32

    def feed(self, data: bytes) -> list[bytes]:
        """Return one answer per request to this address."""
        *lines, self._pending = (self._pending + data).split(b'\r')
        answers = []
        for line in lines:
            text = line.decode('latin-1').strip()
            if text.startswith(self._prefix):
                answers.append(self._answer(text[len(self._prefix) :]).encode('latin-1') + b'\r')
        return answers

    def _answer(self, request: str) -> str:
        kind, rest = request[:1], request[1:].split()
        if kind == 'I':
            return self._image()
        if kind == '?':
            return f'{self._plant.identity}\rASCII description of control string\rCV01 Temperature'
        if kind == 'U' and len(rest) == 4:
            return '0'
        if kind != 'E' or len(rest) != SET_VALUES + 1 or self._plant.refuses:
            return '1'
        return self._take(rest)

    def _image(self) -> str:
        chamber = self._plant.chamber
        if chamber.alarms:  # the protocol reports no alarm: the chamber only stops
            chamber.stop()
        reading = chamber.read()
        self._set[0] = chamber.setpoint
        actual = [reading.air, 100.0 * (reading.humidity or 0.0), *self._set[2:]]
        values = [value for pair in zip(self._set, actual, strict=True) for value in pair]
        bits = self._bits[:START_BIT] + str(int(chamber.running)) + self._bits[START_BIT + 1 :]
        return ' '.join([*(f'{value:06.1f}' for value in values), bits])

    def _take(self, rest: list[str]) -> str:
        chamber = self._plant.chamber
        try:
            values = [float(field) for field in rest[:-1]]
            chamber.set_temperature(values[0])
            if rest[-1][START_BIT] == '1':
                chamber.run()
            else:
                chamber.stop()
        except (ValueError, ChamberRefusalError):
            return '1'
        self._set, self._bits = values, rest[-1]
        return '0'


class SimservServer:
    """Requests `CMD¶chamber¶arguments` ended by CR, ¶ being 0xB6."""

    def __init__(self, plant: EmulatedPlant, address: int = 1) -> None:
        self._plant = plant
        self._address = str(address).encode('ascii')
        self._pending = b''

    def feed(self, data: bytes) -> list[bytes]:
        """Return one answer per request."""
        *lines, self._pending = (self._pending + data).split(b'\r')
        return [self._answer(line.strip(b'\n').split(SEPARATOR)) + b'\r\n' for line in lines]

    def _answer(self, parts: list[bytes]) -> bytes:
        command, arguments = parts[0], parts[2:]
        if len(parts) < 2 or parts[1] != self._address:
            return b'-6'
        chamber = self._plant.chamber
        values: dict[bytes, Callable[[], str]] = {
            b'99997': lambda: self._plant.identity,
            b'10012': self._status,
            b'11002': lambda: f'{chamber.setpoint:.1f}',
            b'11004': lambda: f'{chamber.read().air:.1f}',
            b'17012': lambda: '' if not chamber.alarms else chamber.alarms[0],
        }
        if command in values:
            return b'1' + SEPARATOR + values[command]().encode('ascii')
        if command not in (b'11001', b'14001', b'11068', b'11072'):
            return b'-5'
        try:
            return self._order(command, [float(argument) for argument in arguments])
        except (ValueError, ChamberRefusalError):
            return b'-6'

    def _status(self) -> str:
        chamber = self._plant.chamber
        return str((3 if chamber.running else 1) + (8 if chamber.alarms else 0))

    def _order(self, command: bytes, arguments: list[float]) -> bytes:
        chamber = self._plant.chamber
        if self._plant.refuses:
            return b'-8'
        if len(arguments) != 2:
            return b'-6'
        if command == b'11001':
            chamber.set_temperature(arguments[1])
        elif command == b'14001':
            if arguments[1]:
                chamber.run()
            else:
                chamber.stop()
        return b'1'
