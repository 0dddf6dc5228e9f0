# SPDX-License-Identifier: Apache-2.0
"""Watlow F4 (TestEquity and many others) over Modbus RTU or TCP.

A temperature is its signed register / 10^decimals. Register 25 (save to EEPROM) is never written.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from chamber_profile.chambers.chamber import ChamberReading, ChamberRefusalError
from chamber_profile.chambers.line import Line
from chamber_profile.chambers.protocol import ChamberAddressError, ChamberProtocol

if TYPE_CHECKING:
    from chamber_profile.chambers.modbus import ModbusRegisters

PROCESS_VALUE, PROFILE_STATUS, SETPOINT = 100, 200, 300
LIMIT_LOW, LIMIT_HIGH, DECIMALS, UNITS = 602, 603, 606, 901
TERMINATE_PROFILE = 1217
"""Register numbers."""
EMULATOR_MARK, EMULATED = 9999, 0x454D
"""A register no F4 has, and the value an emulator has there."""
RUNNING_STATUSES = (2, 3)
"""Values of PROFILE_STATUS while the controller's own profile runs or is held."""
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

    def __init__(self, registers: ModbusRegisters, *, cond_event: int = 1) -> None:
        self._registers = registers
        self._event = event_register(cond_event)
        self._scale = 10.0
        self.emulated = False

    @property
    def resolution_c(self) -> float:
        """Step of a register [K]."""
        return 1.0 / self._scale

    def connect(self) -> str:
        """Open the line and read scale and limits."""
        self._registers.open()
        (decimals,) = self._registers.read(DECIMALS)
        (units,) = self._registers.read(UNITS)
        if decimals not in range(4) or units != 1:
            raise ChamberRefusalError(
                f'F4: decimals {decimals}, units {units}: set the controller to °C (units 1)'
            )
        self._scale = 10.0**decimals
        try:
            self.emulated = self._registers.read(EMULATOR_MARK) == [EMULATED]
        except ChamberRefusalError:
            self.emulated = False
        low, high = self._registers.read(LIMIT_LOW, 2)
        kind = 'EMULATED ' if self.emulated else ''
        reach = f'{low / self._scale:g} … {high / self._scale:g} °C'
        return f'{kind}Watlow F4, {decimals} decimals, limits {reach}'

    def read(self) -> ChamberReading:
        """Return process value, set-point and the event that switches the chamber on."""
        (air,) = self._registers.read(PROCESS_VALUE)
        (setpoint,) = self._registers.read(SETPOINT)
        (on,) = self._registers.read(self._event)
        return ChamberReading(air / self._scale, setpoint / self._scale, on == 1)

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Program the set-point limits and read them back."""
        wanted = [round(low_c * self._scale), round(high_c * self._scale)]
        self._registers.write(LIMIT_LOW, wanted[0])
        self._registers.write(LIMIT_HIGH, wanted[1])
        if self._registers.read(LIMIT_LOW, 2) != wanted:
            raise ChamberRefusalError(f'F4: limits {low_c:g} … {high_c:g} °C were not taken')

    def set_temperature(self, temperature_c: float) -> None:
        """Write the set-point."""
        self._registers.write(SETPOINT, round(temperature_c * self._scale))

    def run(self) -> None:
        """End the controller's own profile where one runs, then switch the chamber on."""
        if self._registers.read(PROFILE_STATUS)[0] in RUNNING_STATUSES:
            self._registers.write(TERMINATE_PROFILE, 1)
        self._registers.write(self._event, 1)

    def stop(self) -> None:
        """Switch the chamber off."""
        self._registers.write(self._event, 0)

    def close(self) -> None:
        """Close the line."""
        self._registers.close()


def _make_watlow(line: Line, options: Mapping[str, int]) -> WatlowF4Chamber:
    try:
        from chamber_profile.chambers.modbus import ModbusRegisters  # imports pymodbus: 0.1 s
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


WATLOW_F4 = ChamberProtocol(make=_make_watlow, options=('address', 'cond_event'), baudrate=19200)
