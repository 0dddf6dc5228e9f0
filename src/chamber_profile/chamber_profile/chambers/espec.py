# SPDX-License-Identifier: Apache-2.0
"""ESPEC P-300 and SCP-220 in ASCII: serial 8N1, RS-485 with an address, or a TCP gateway.

One request line, one answer line, both ending in CR LF. Queries answer bare data, orders echo
`OK:<order>`, failures are `NA:<reason>`.
"""

from __future__ import annotations

from chamber_profile.chambers.chamber import ChamberError, ChamberReading, ChamberRefusalError
from chamber_profile.chambers.line import Line, until
from chamber_profile.chambers.protocol import ChamberProtocol

LINE_END = b'\r\n'
RUNNING_MODES = ('CONSTANT', 'RUN')
"""Modes in which the chamber conditions the air (`RUN …` with a program)."""


class EspecChamber:
    """A chamber with an ESPEC controller."""

    resolution_c = 0.1
    programs_limits = True

    def __init__(self, line: Line, address: int = 0) -> None:
        self._line = line
        self._prefix = f'{address},' if address else ''
        self.emulated = False

    def connect(self) -> str:
        """Open the line and return the controller's own description."""
        self._line.open()
        rom = self._ask('ROM?')
        self.emulated = rom.upper().startswith('EMULATED')
        return f'ESPEC {rom}, {self._ask("TYPE?")}'

    def read(self) -> ChamberReading:
        """Return temperature and set-point (`TEMP?`), mode and alarms (`MON?`, `ALARM?`)."""
        air, setpoint, _, _ = self._temperatures()
        fields = self._ask('MON?').split(',')
        if len(fields) != 4:
            raise ChamberError(f'ESPEC: MON? answered {",".join(fields)!r}')
        humidity = _number(fields[1]) / 100.0 if fields[1].strip() else None
        alarms: tuple[str, ...] = ()
        if int(_number(fields[3])):
            alarms = tuple(self._ask('ALARM?').split(',')[1:]) or ('unknown',)
        running = fields[2].strip().split(' ')[0] in RUNNING_MODES
        return ChamberReading(
            air=air, setpoint=setpoint, running=running, alarms=alarms, humidity=humidity
        )

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Program both limits, with the present set-point moved inside them; read them back."""
        _, setpoint, _, _ = self._temperatures()
        inside = min(max(setpoint, low_c), high_c)
        self._order(f'TEMP, S{inside:.1f} H{high_c:.1f} L{low_c:.1f}')
        _, _, high, low = self._temperatures()
        if abs(high - high_c) > 0.051 or abs(low - low_c) > 0.051:
            raise ChamberRefusalError(
                f'ESPEC: limits are {low:g} … {high:g} °C, not {low_c:g} … {high_c:g} °C'
            )

    def set_temperature(self, temperature_c: float) -> None:
        """Write the set-point."""
        self._order(f'TEMP, S{temperature_c:.1f}')

    def run(self) -> None:
        """Condition the air at the set-point; switch the power on first where it is off."""
        if self._ask('MODE?').strip() == 'OFF':
            self._order('POWER,ON')
        self._order('MODE,CONSTANT')

    def stop(self) -> None:
        """Go to stand-by."""
        self._order('MODE,STANDBY')

    def close(self) -> None:
        """Close the line."""
        self._line.close()

    def _temperatures(self) -> tuple[float, float, float, float]:
        fields = self._ask('TEMP?').split(',')
        if len(fields) != 4:
            raise ChamberError(f'ESPEC: TEMP? answered {",".join(fields)!r}')
        air, setpoint, high, low = (_number(field) for field in fields)
        return air, setpoint, high, low

    def _ask(self, request: str) -> str:
        raw = self._line.ask((self._prefix + request).encode('ascii') + LINE_END, until(LINE_END))
        try:
            answer = raw[: -len(LINE_END)].decode('ascii')
        except UnicodeDecodeError as error:
            self._line.close()
            raise ChamberError(f'ESPEC: {request} answered {raw!r}') from error
        if answer.startswith('NA:'):
            raise ChamberRefusalError(f'ESPEC refused {request}: {answer[3:]}')
        return answer

    def _order(self, order: str) -> None:
        answer = self._ask(order)
        if answer.replace(' ', '') != f'OK:{order}'.replace(' ', ''):
            self._line.close()
            raise ChamberError(f'ESPEC: {order} answered {answer!r}')


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise ChamberError(f'ESPEC: {text!r} is no number') from error


ESPEC = ChamberProtocol(
    make=lambda line, options: EspecChamber(line, options.get('address', 0)),
    options=('address',),
    baudrate=19200,
)
