# SPDX-License-Identifier: Apache-2.0
"""Watlow F4 (TestEquity and many others) over Modbus RTU or TCP.

Registers are signed 16 bit; a temperature is its register / 10^decimals. Register 25 (save to
EEPROM) is never touched.
"""

from __future__ import annotations

from chamber_profile.chambers import modbus
from chamber_profile.chambers.chamber import ChamberError, ChamberReading, ChamberRefusalError
from chamber_profile.chambers.line import Line

PROCESS_VALUE, PROFILE_STATUS, SETPOINT = 100, 200, 300
LIMIT_LOW, LIMIT_HIGH, DECIMALS, UNITS = 602, 603, 606, 901
TERMINATE_PROFILE = 1217
EMULATOR_MARK, EMULATED = 9999, 0x454D
"""A register no F4 has, and what an emulator answers there."""
RUNNING_PROFILE = (2, 3)
RTU_PAUSE_S = 0.03
"""Silence between two RTU requests [s]."""


def event_register(event: int) -> int:
    """Return the register of an event output (1 …).

    >>> event_register(1), event_register(2)
    (2000, 2010)
    """
    return 2000 + 10 * (event - 1)


class WatlowF4Chamber:
    """A chamber with an F4 controller; `cond_event` is the event output that switches it on."""

    programs_limits = True

    def __init__(
        self, line: Line, address: int = 1, *, tcp: bool = False, cond_event: int = 1
    ) -> None:
        self._line = line
        self._address = address
        self._tcp = tcp
        self._event = event_register(cond_event)
        self._transaction = 0
        self._scale = 10.0
        self.emulated = False

    @property
    def resolution_c(self) -> float:
        """Step of a register [K]."""
        return 1.0 / self._scale

    def connect(self) -> str:
        """Open the line, read the scale and see to it that no profile of its own runs."""
        self._line.open()
        (decimals,) = self._read(DECIMALS)
        (units,) = self._read(UNITS)
        if decimals not in range(4) or units != 1:
            raise ChamberRefusalError(
                f'F4: decimals {decimals}, units {units}: set the controller to °C (units 1)'
            )
        self._scale = 10.0**decimals
        try:
            self.emulated = self._read(EMULATOR_MARK) == [EMULATED]
        except ChamberRefusalError:
            self.emulated = False
        low, high = self._read(LIMIT_LOW, 2)
        kind = 'EMULATED ' if self.emulated else ''
        reach = f'{low / self._scale:g} … {high / self._scale:g} °C'
        return f'{kind}Watlow F4, {decimals} decimals, limits {reach}'

    def read(self) -> ChamberReading:
        """Return process value, set-point and the event that switches the chamber on."""
        (air,) = self._read(PROCESS_VALUE)
        (setpoint,) = self._read(SETPOINT)
        (on,) = self._read(self._event)
        return ChamberReading(air / self._scale, setpoint / self._scale, on == 1)

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Program the set-point limits and read them back."""
        wanted = [round(low_c * self._scale), round(high_c * self._scale)]
        self._write(LIMIT_LOW, wanted[0])
        self._write(LIMIT_HIGH, wanted[1])
        if self._read(LIMIT_LOW, 2) != wanted:
            raise ChamberRefusalError(f'F4: limits {low_c:g} … {high_c:g} °C were not taken')

    def set_temperature(self, temperature_c: float) -> None:
        """Write the set-point."""
        self._write(SETPOINT, round(temperature_c * self._scale))

    def run(self) -> None:
        """End a profile of the controller's own, then switch the chamber on."""
        if self._read(PROFILE_STATUS)[0] in RUNNING_PROFILE:
            self._write(TERMINATE_PROFILE, 1)
        self._write(self._event, 1)

    def stop(self) -> None:
        """Switch the chamber off."""
        self._write(self._event, 0)

    def close(self) -> None:
        """Close the line."""
        self._line.close()

    def _read(self, register: int, count: int = 1) -> list[int]:
        return self._exchange(modbus.read_pdu(register, count))

    def _write(self, register: int, value: int) -> None:
        self._exchange(modbus.write_pdu(register, value))

    def _exchange(self, request: bytes) -> list[int]:
        try:
            if self._tcp:
                self._transaction = self._transaction % 0xFFFF + 1
                frame = modbus.tcp_frame(self._transaction, self._address, request)
                raw = self._line.ask(frame, modbus.tcp_answer_length)
                answer = modbus.tcp_pdu(self._transaction, self._address, raw)
            else:
                frame = modbus.rtu_frame(self._address, request)
                raw = self._line.ask(frame, modbus.rtu_answer_length)
                answer = modbus.rtu_pdu(self._address, raw)
            return modbus.answer_values(request, answer)
        except modbus.ModbusRefusalError as error:
            raise ChamberRefusalError(f'F4 refused {request.hex(" ")}: {error}') from error
        except modbus.ModbusError as error:
            self._line.close()
            raise ChamberError(f'F4: {error}') from error
