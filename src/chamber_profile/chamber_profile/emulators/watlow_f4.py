# SPDX-License-Identifier: Apache-2.0
"""A Watlow F4's answers over Modbus RTU and TCP."""

from __future__ import annotations

import struct

from chamber_profile.chambers import modbus, watlow_f4
from chamber_profile.chambers.chamber import ChamberRefusalError
from chamber_profile.emulators.plant import EmulatedBody

SCALE = 10.0
EVENT = watlow_f4.event_register(1)


class F4Registers:
    """The controller's registers on top of a body; one decimal, °C."""

    def __init__(self, body: EmulatedBody) -> None:
        self._body = body

    def answer(self, pdu: bytes) -> bytes:
        """Return the answer PDU to a request PDU."""
        function = pdu[0] if pdu else 0
        try:
            if function == modbus.READ and len(pdu) == 5:
                return self._read(*struct.unpack('>HH', pdu[1:]))
            if function == modbus.WRITE and len(pdu) == 5:
                self._write(*struct.unpack('>Hh', pdu[1:]))
                return pdu
            if function == modbus.WRITE_MANY and len(pdu) >= 8:
                first, count = struct.unpack('>HH', pdu[1:5])
                for i, value in enumerate(struct.unpack(f'>{count}h', pdu[6:])):
                    self._write(first + i, value)
                return pdu[:5]
        except KeyError:
            return bytes([function | modbus.EXCEPTION, 2])
        except (struct.error, ChamberRefusalError):
            return bytes([function | modbus.EXCEPTION, 3])
        return bytes([function | modbus.EXCEPTION, 1])

    def _read(self, first: int, count: int) -> bytes:
        chamber = self._body.chamber
        if chamber.alarms:  # no register says so: the controller switches the chamber off
            chamber.stop()
        low, high = chamber.limits
        table = {
            watlow_f4.PROCESS_VALUE: chamber.read().air * SCALE,
            103: 100.0 * self._body.heater_percent,
            watlow_f4.PROFILE_STATUS: 0,
            watlow_f4.SETPOINT: chamber.setpoint * SCALE,
            watlow_f4.LIMIT_LOW: low * SCALE,
            watlow_f4.LIMIT_HIGH: high * SCALE,
            watlow_f4.DECIMALS: 1,
            watlow_f4.UNITS: 1,
            EVENT: int(chamber.running),
            watlow_f4.EMULATOR_MARK: watlow_f4.EMULATED,
        }
        values = [round(table[first + i]) for i in range(count)]
        return bytes([modbus.READ, 2 * count]) + struct.pack(f'>{count}h', *values)

    def _write(self, register: int, value: int) -> None:
        chamber = self._body.chamber
        if self._body.refuses:
            raise ChamberRefusalError('locked')
        if register == watlow_f4.SETPOINT:
            chamber.set_temperature(value / SCALE)
        elif register == watlow_f4.LIMIT_LOW:
            chamber.set_limits(value / SCALE, chamber.limits[1])
        elif register == watlow_f4.LIMIT_HIGH:
            chamber.set_limits(chamber.limits[0], value / SCALE)
        elif register == EVENT:
            if value:
                chamber.run()
            else:
                chamber.stop()
        elif register != watlow_f4.TERMINATE_PROFILE:
            raise KeyError(register)


class WatlowRtuServer:
    """Frames on a serial line; what has a wrong CRC or another address gets no answer."""

    def __init__(self, body: EmulatedBody, address: int = 1) -> None:
        self._registers = F4Registers(body)
        self._address = address
        self._pending = b''

    def feed(self, data: bytes) -> list[bytes]:
        """Return one answer per whole request."""
        self._pending += data
        answers = []
        while len(self._pending) >= 8:
            size = 8 if self._pending[1] != modbus.WRITE_MANY else 9 + self._pending[6]
            if len(self._pending) < size:
                break
            frame, self._pending = self._pending[:size], self._pending[size:]
            try:
                pdu = modbus.rtu_pdu(self._address, frame)
            except modbus.ModbusError:
                self._pending = b''
                break
            answers.append(modbus.rtu_frame(self._address, self._registers.answer(pdu)))
        return answers


class WatlowTcpServer:
    """Frames behind a Modbus TCP gateway."""

    def __init__(self, body: EmulatedBody, address: int = 1) -> None:
        self._registers = F4Registers(body)
        self._address = address
        self._pending = b''

    def feed(self, data: bytes) -> list[bytes]:
        """Return one answer per whole request."""
        self._pending += data
        answers = []
        while size := modbus.tcp_answer_length(self._pending):
            if len(self._pending) < size:
                break
            frame, self._pending = self._pending[:size], self._pending[size:]
            transaction = struct.unpack('>H', frame[:2])[0]
            answer = self._registers.answer(frame[7:])
            answers.append(modbus.tcp_frame(transaction, frame[6], answer))
        return answers
