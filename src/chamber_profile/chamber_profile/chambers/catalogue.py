# SPDX-License-Identifier: Apache-2.0
"""The catalogue of chamber protocols, and the parsing of chamber addresses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from urllib.parse import parse_qsl, urlsplit

from imu_recording.user_error import UserError

from chamber_profile.chambers.chamber import Chamber
from chamber_profile.chambers.espec import EspecChamber
from chamber_profile.chambers.line import TIMEOUT_S, Line
from chamber_profile.chambers.votsch import Ascii2Chamber, Layout, SimservChamber

GROUP = 'chamber_profile.chambers'
"""Entry point group of further chambers: functions of (line, options) → Chamber."""

MakeChamber = Callable[[Line, Mapping[str, int]], Chamber]


def _make_ascii2(line: Line, options: Mapping[str, int]) -> Chamber:
    layout = {key: value for key, value in options.items() if key not in ('address', 'tcp')}
    return Ascii2Chamber(line, options.get('address', 1), Layout(**layout))


def _make_watlow(line: Line, options: Mapping[str, int]) -> Chamber:
    try:
        from chamber_profile.chambers.modbus import ModbusRegisters  # and pymodbus
        from chamber_profile.chambers.watlow_f4 import RTU_PAUSE_S, WatlowF4Chamber
    except ImportError as error:
        raise ChamberAddressError(
            f'chamber watlow_f4 needs pymodbus 3.11 or later (pip install "pymodbus>=3.11,<4"): '
            f'{error}'
        ) from error
    tcp = bool(options['tcp'])
    if not tcp:
        line.pause_s = RTU_PAUSE_S
    registers = ModbusRegisters(line, options.get('address', 1), tcp=tcp)
    return WatlowF4Chamber(registers, cond_event=options.get('cond_event', 1))


CHAMBERS: dict[str, MakeChamber] = {
    'espec': lambda line, options: EspecChamber(line, options.get('address', 0)),
    'ascii2': _make_ascii2,
    'simserv': lambda line, options: SimservChamber(line, options.get('address', 1)),
    'watlow_f4': _make_watlow,
}
"""Protocol → function of a line and options."""
OPTIONS: dict[str, tuple[str, ...]] = {
    'espec': ('address',),
    'ascii2': ('address', *Layout.__dataclass_fields__),
    'simserv': ('address',),
    'watlow_f4': ('address', 'cond_event'),
}
"""Protocol → whole-number options of its address, beside `baudrate` and `timeout`."""
BAUDRATES = {'espec': 19200, 'ascii2': 9600, 'simserv': 19200, 'watlow_f4': 19200}

EXAMPLES = 'simulated, espec+tcp://192.168.0.5:10001, watlow_f4+serial:///dev/ttyUSB0?address=1'


class ChamberAddressError(UserError):
    """A `chamber` parameter that names no chamber; the message gives an example."""


def known_chambers() -> dict[str, MakeChamber]:
    """Return the catalogue with the chambers of other packages."""
    return {point.name: point.load() for point in entry_points(group=GROUP)} | CHAMBERS


def open_chamber(address: str) -> Chamber:
    """Return the chamber of `simulated[?seed=N]` or `PROTOCOL+tcp|serial://…`; not connected."""
    head, _, rest = address.partition('://')
    query = dict(parse_qsl(address.partition('?')[2], keep_blank_values=True))
    if head.partition('?')[0] == 'simulated':
        from chamber_profile.chambers.simulated import SimulatedChamber  # and numba

        return SimulatedChamber(seed=_whole(address, query, 'seed', 0))
    protocol, _, transport = head.partition('+')
    known = known_chambers()
    if protocol not in known or transport not in ('tcp', 'serial'):
        raise ChamberAddressError(
            f'chamber is {address!r}; write e.g. {EXAMPLES} '
            f'(protocols: simulated, {", ".join(sorted(known))})'
        )
    timeout = _whole(address, query, 'timeout', round(TIMEOUT_S))
    baudrate = _whole(address, query, 'baudrate', BAUDRATES.get(protocol, 9600))
    allowed = OPTIONS.get(protocol)
    unknown = sorted(set(query) - {'timeout', 'baudrate', *(allowed or query)})
    if unknown:
        known_options = ', '.join(('baudrate', 'timeout', *(allowed or ())))
        raise ChamberAddressError(f'chamber option {unknown[0]!r}; known: {known_options}')
    options = {name: _whole(address, query, name, 0) for name in query}
    for name in ('timeout', 'baudrate'):
        options.pop(name, None)
    line = Line(_port(address, transport, rest), baudrate, float(timeout))
    return known[protocol](line, {**options, 'tcp': int(transport == 'tcp')})


def _port(address: str, transport: str, rest: str) -> str:
    parts = urlsplit(f'line://{rest}')  # urlsplit knows no scheme with an underscore
    if transport == 'serial':
        if not parts.path.startswith('/') or parts.netloc:
            raise ChamberAddressError(f'chamber is {address!r}: write serial:///dev/…')
        return parts.path
    try:
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise ChamberAddressError(f'chamber is {address!r}: {error}') from error
    if not host or not port:
        raise ChamberAddressError(f'chamber is {address!r}: write tcp://HOST:PORT')
    return f'socket://{host}:{port}'


def _whole(address: str, query: Mapping[str, str], name: str, default: int) -> int:
    text = query.get(name, str(default))
    try:
        return int(text)
    except ValueError as error:
        raise ChamberAddressError(f'chamber is {address!r}: {name} is no whole number') from error
