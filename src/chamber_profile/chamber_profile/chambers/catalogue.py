# SPDX-License-Identifier: Apache-2.0
"""The catalogue of chamber protocols, and the chamber of an address."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import entry_points
from urllib.parse import parse_qsl, urlsplit

from chamber_profile.chambers.chamber import Chamber
from chamber_profile.chambers.espec import ESPEC
from chamber_profile.chambers.line import ANSWER_TIMEOUT_S, Line
from chamber_profile.chambers.protocol import ChamberAddressError, ChamberProtocol
from chamber_profile.chambers.votsch import ASCII2, SIMSERV
from chamber_profile.chambers.watlow_f4 import WATLOW_F4

CHAMBERS: dict[str, ChamberProtocol] = {
    'espec': ESPEC,
    'ascii2': ASCII2,
    'simserv': SIMSERV,
    'watlow_f4': WATLOW_F4,
}
ENTRY_POINT_GROUP = 'chamber_profile.chambers'
"""Entry point group of further protocols: a ChamberProtocol, or its function `make`."""

EXAMPLE_ADDRESSES = (
    'simulated, espec+tcp://192.168.0.5:10001, watlow_f4+serial:///dev/ttyUSB0?address=1'
)


def known_chambers() -> dict[str, ChamberProtocol]:
    """Return the catalogue with the protocols of other packages."""
    others = {point.name: point.load() for point in entry_points(group=ENTRY_POINT_GROUP)}
    return {
        name: other if isinstance(other, ChamberProtocol) else ChamberProtocol(other)
        for name, other in others.items()
    } | CHAMBERS


def open_chamber(address: str) -> Chamber:
    """Return the chamber of `simulated[?seed=N]` or `PROTOCOL+tcp|serial://…`; not connected."""
    head, _, rest = address.partition('://')
    query = dict(parse_qsl(address.partition('?')[2], keep_blank_values=True))
    if head.partition('?')[0] == 'simulated':
        from chamber_profile.chambers.simulated import SimulatedChamber  # imports numba

        return SimulatedChamber(seed=_whole(address, query, 'seed', 0))
    name, _, transport = head.partition('+')
    known = known_chambers()
    if name not in known or transport not in ('tcp', 'serial'):
        raise ChamberAddressError(
            f'chamber is {address!r}; write e.g. {EXAMPLE_ADDRESSES} '
            f'(protocols: simulated, {", ".join(sorted(known))})'
        )
    protocol = known[name]
    timeout = _whole(address, query, 'timeout', round(ANSWER_TIMEOUT_S))
    baudrate = _whole(address, query, 'baudrate', protocol.baudrate)
    options = _options(address, query, protocol)
    line = Line(_port(address, transport, rest), baudrate, float(timeout))
    return protocol.make(line, {**options, 'tcp': int(transport == 'tcp')})


def _options(address: str, query: Mapping[str, str], protocol: ChamberProtocol) -> dict[str, int]:
    """Return the protocol's own options; refuse unknown ones."""
    line_options = ('baudrate', 'timeout')
    own = [name for name in query if name not in line_options]
    unknown = sorted(set(own) - set(own if protocol.options is None else protocol.options))
    if unknown:
        known = ', '.join((*line_options, *(protocol.options or ())))
        raise ChamberAddressError(f'chamber option {unknown[0]!r}; known: {known}')
    return {name: _whole(address, query, name, 0) for name in own}


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
