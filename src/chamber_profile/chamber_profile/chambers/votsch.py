# SPDX-License-Identifier: Apache-2.0
"""Weiss and Vötsch chambers: SIMPAC ASCII-2 (serial, TCP 2049) and SIMSERV (TCP 2049).

Neither protocol can program limits: they are set at the panel.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from chamber_profile.chambers.chamber import ChamberError, ChamberReading, ChamberRefusalError
from chamber_profile.chambers.line import Line, until
from chamber_profile.chambers.protocol import ChamberProtocol

DIGITAL_CHANNELS = 32
"""Number of digital bits in an ASCII-2 string."""
SEPARATOR = b'\xb6'
STATUS_RUNNING, STATUS_ALARM = 2, 8
"""Bits of SIMSERV's status: 1 stands by, 3 runs, + 4 warning, + 8 alarm."""


@dataclass(frozen=True)
class Layout:
    """Positions of the values in ASCII-2, which differ between models (`$01?` lists them)."""

    n_set: int = 7
    """Set values of an `E` string."""
    n_read: int = 14
    """Values of an `I` answer before the bits: pairs of nominal and actual."""
    idx_temp: int = 0
    """Index of the temperature's pair."""
    idx_humidity: int = 1
    """Index of the humidity's pair; −1: none."""
    start_bit: int = 1
    """Digital output that starts the chamber."""
    alarm_bit: int = -1
    """Digital bit that reports an alarm; −1: none."""


class Ascii2Chamber:
    """A chamber that speaks SIMPAC ASCII-2.

    An `E` string overwrites all values: those that are to stay are read first and written back.
    """

    resolution_c = 0.1
    programs_limits = False

    def __init__(self, line: Line, address: int = 1, layout: Layout | None = None) -> None:
        self._line = line
        self._prefix = f'${address:02d}'
        self._layout = layout or Layout()
        self.emulated = False

    def connect(self) -> str:
        """Open the line and return the chamber's own list of its values."""
        self._line.open()
        text = self._line.ask_text(f'{self._prefix}?\r'.encode('ascii')).decode('latin-1')
        self.emulated = 'EMULATED CHAMBER' in text
        self._values()
        return f'ASCII-2 {" ".join(text.split())[:80]}'

    def read(self) -> ChamberReading:
        """Return temperature, humidity and bits (`I`)."""
        layout = self._layout
        values, bits = self._values()
        humidity = None
        if layout.idx_humidity >= 0:
            humidity = values[2 * layout.idx_humidity + 1] / 100.0
        alarm = layout.alarm_bit >= 0 and bits[layout.alarm_bit] == '1'
        return ChamberReading(
            air=values[2 * layout.idx_temp + 1],
            setpoint=values[2 * layout.idx_temp],
            running=bits[layout.start_bit] == '1',
            alarms=('alarm bit',) if alarm else (),
            humidity=humidity,
        )

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Do nothing: the protocol has no limits (`programs_limits`)."""

    def set_temperature(self, temperature_c: float) -> None:
        """Write the set-point and leave the other values."""
        values, bits = self._values()
        self._write(values, bits, temperature_c)

    def run(self) -> None:
        """Set the start bit."""
        self._start(on=True)

    def stop(self) -> None:
        """Clear the start bit."""
        self._start(on=False)

    def close(self) -> None:
        """Close the line."""
        self._line.close()

    def _start(self, *, on: bool) -> None:
        values, bits = self._values()
        place = self._layout.start_bit
        bits = bits[:place] + ('1' if on else '0') + bits[place + 1 :]
        self._write(values, bits, values[2 * self._layout.idx_temp])

    def _values(self) -> tuple[list[float], str]:
        raw = self._line.ask(f'{self._prefix}I\r'.encode('ascii'), until(b'\r'))
        *fields, bits = raw.decode('latin-1').split() or ['']
        try:
            values = [float(field) for field in fields]
        except ValueError:
            values = []
        if (
            len(values) != self._layout.n_read
            or len(bits) != DIGITAL_CHANNELS
            or set(bits) - {'0', '1'}
        ):
            self._line.close()
            raise ChamberError(f'ASCII-2: I answered {raw!r}, expected {self._layout}')
        return values, bits

    def _write(self, values: list[float], bits: str, temperature_c: float) -> None:
        nominal = [*values[::2], *(0.0 for _ in range(self._layout.n_set))][: self._layout.n_set]
        nominal[self._layout.idx_temp] = temperature_c
        text = ' '.join(f'{value:06.1f}' for value in nominal)
        request = f'{self._prefix}E {text} {bits}\r'.encode('ascii')
        answer = self._line.ask(request, until(b'\r'))
        if answer.strip() != b'0':
            raise ChamberRefusalError(f'ASCII-2 refused {request!r}: {answer!r}')


class SimservChamber:
    """A chamber that speaks SIMSERV: numbered commands, arguments separated by 0xB6."""

    resolution_c = 0.1
    programs_limits = False

    def __init__(self, line: Line, address: int = 1) -> None:
        self._line = line
        self._chamber = address
        self.emulated = False

    def connect(self) -> str:
        """Open the line and return the chamber's type."""
        self._line.open()
        kind = self._ask(99997, 1)
        self.emulated = kind.upper().startswith('EMULATED')
        return f'SIMSERV {kind}'

    def read(self) -> ChamberReading:
        """Return temperature, set-point and status."""
        status = int(self._number(10012))
        return ChamberReading(
            air=self._number(11004, 1),
            setpoint=self._number(11002, 1),
            running=bool(status & STATUS_RUNNING),
            alarms=(f'status {status}',) if status & STATUS_ALARM else (),
        )

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Do nothing: the protocol has no limits (`programs_limits`)."""

    def set_temperature(self, temperature_c: float) -> None:
        """Write the set-point."""
        self._ask(11001, 1, f'{temperature_c:.1f}')

    def run(self) -> None:
        """Start."""
        self._ask(14001, 1, 1)

    def stop(self) -> None:
        """Stop."""
        self._ask(14001, 1, 0)

    def close(self) -> None:
        """Close the line."""
        self._line.close()

    def _number(self, command: int, *arguments: object) -> float:
        text = self._ask(command, *arguments)
        try:
            return float(text)
        except ValueError as error:
            self._line.close()
            raise ChamberError(f'SIMSERV: {command} answered {text!r}') from error

    def _ask(self, command: int, *arguments: object) -> str:
        parts = [str(part).encode('ascii') for part in (command, self._chamber, *arguments)]
        raw = self._line.ask(SEPARATOR.join(parts) + b'\r', until(b'\r\n'))
        code, *values = raw[:-2].split(SEPARATOR)
        if code == b'1' and len(values) <= 1 and all(value.isascii() for value in values):
            return values[0].decode('ascii') if values else ''
        if code in (b'-5', b'-6', b'-8'):
            raise ChamberRefusalError(f'SIMSERV refused {command}: {code.decode("ascii")}')
        self._line.close()
        raise ChamberError(f'SIMSERV: {command} answered {raw!r}')


def _make_ascii2(line: Line, options: Mapping[str, int]) -> Ascii2Chamber:
    layout = {key: value for key, value in options.items() if key not in ('address', 'tcp')}
    return Ascii2Chamber(line, options.get('address', 1), Layout(**layout))


ASCII2 = ChamberProtocol(
    make=_make_ascii2, options=('address', *Layout.__dataclass_fields__), baudrate=9600
)
SIMSERV = ChamberProtocol(
    make=lambda line, options: SimservChamber(line, options.get('address', 1)),
    options=('address',),
    baudrate=19200,
)
