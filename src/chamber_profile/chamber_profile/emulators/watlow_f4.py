# SPDX-License-Identifier: Apache-2.0
"""A Watlow F4's answers over Modbus RTU and TCP."""

from __future__ import annotations

from pymodbus.constants import ExcCodes
from pymodbus.pdu import ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
    WriteMultipleRegistersRequest,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterRequest,
    WriteSingleRegisterResponse,
)

from chamber_profile.chambers import watlow_f4
from chamber_profile.chambers.chamber import ChamberRefusalError
from chamber_profile.chambers.modbus import framer
from chamber_profile.emulators.plant import EmulatedPlant

COUNTS_PER_DEGREE = 10.0
"""Register counts per °C: one decimal."""
EVENT_REGISTER = watlow_f4.event_register(1)
MAX_FRAME_BYTES = 260
"""Longest frame of Modbus, that of TCP; more bytes without a frame are dropped."""


class F4Registers:
    """The controller's registers on top of a plant; one decimal, °C."""

    def __init__(self, plant: EmulatedPlant) -> None:
        self._plant = plant

    def answer(self, request: ModbusPDU) -> ModbusPDU:
        """Return the answer to a request."""
        try:
            match request:
                case ReadHoldingRegistersRequest(function_code=3):
                    return ReadHoldingRegistersResponse(registers=self._read(request))
                case WriteSingleRegisterRequest():
                    self._write(request.address, request.registers[0])
                    return WriteSingleRegisterResponse(
                        address=request.address, registers=request.registers
                    )
                case WriteMultipleRegistersRequest() if len(request.registers) == request.count:
                    for i, value in enumerate(request.registers):
                        self._write(request.address + i, value)
                    return WriteMultipleRegistersResponse(
                        address=request.address, count=request.count
                    )
                case WriteMultipleRegistersRequest():
                    return ExceptionResponse(request.function_code, ExcCodes.ILLEGAL_VALUE)
        except KeyError:
            return ExceptionResponse(request.function_code, ExcCodes.ILLEGAL_ADDRESS)
        except ChamberRefusalError:
            return ExceptionResponse(request.function_code, ExcCodes.ILLEGAL_VALUE)
        return ExceptionResponse(request.function_code, ExcCodes.ILLEGAL_FUNCTION)

    def _read(self, request: ReadHoldingRegistersRequest) -> list[int]:
        chamber = self._plant.chamber
        if chamber.alarms:  # no register says so: the controller switches the chamber off
            chamber.stop()
        low, high = chamber.limits
        table = {
            watlow_f4.PROCESS_VALUE: chamber.read().air * COUNTS_PER_DEGREE,
            103: 100.0 * self._plant.heater_percent,
            watlow_f4.PROFILE_STATUS: 0,
            watlow_f4.SETPOINT: chamber.setpoint * COUNTS_PER_DEGREE,
            watlow_f4.LIMIT_LOW: low * COUNTS_PER_DEGREE,
            watlow_f4.LIMIT_HIGH: high * COUNTS_PER_DEGREE,
            watlow_f4.DECIMALS: 1,
            watlow_f4.UNITS: 1,
            EVENT_REGISTER: int(chamber.running),
            watlow_f4.EMULATOR_MARK: watlow_f4.EMULATED,
        }
        return [round(table[request.address + i]) & 0xFFFF for i in range(request.count)]

    def _write(self, register: int, unsigned: int) -> None:
        chamber = self._plant.chamber
        value = unsigned - 0x10000 if unsigned & 0x8000 else unsigned
        if self._plant.refuses:
            raise ChamberRefusalError('locked')
        if register == watlow_f4.SETPOINT:
            chamber.set_temperature(value / COUNTS_PER_DEGREE)
        elif register == watlow_f4.LIMIT_LOW:
            chamber.set_limits(value / COUNTS_PER_DEGREE, chamber.limits[1])
        elif register == watlow_f4.LIMIT_HIGH:
            chamber.set_limits(chamber.limits[0], value / COUNTS_PER_DEGREE)
        elif register == EVENT_REGISTER:
            if value:
                chamber.run()
            else:
                chamber.stop()
        elif register != watlow_f4.TERMINATE_PROFILE:
            raise KeyError(register)


class WatlowF4Server:
    """Frames on a serial line, or behind a TCP gateway (which answers for any address).

    A serial frame with a wrong CRC or another address gets no answer.
    """

    def __init__(self, plant: EmulatedPlant, address: int = 1, *, tcp: bool = False) -> None:
        self._registers = F4Registers(plant)
        self._framer = framer(tcp=tcp, is_server=True)
        self._address = None if tcp else address
        self._pending = b''

    def feed(self, data: bytes) -> list[bytes]:
        """Return one answer per whole request."""
        self._pending += data
        answers = []
        while True:
            used, address, transaction, pdu = self._framer.decode(self._pending)
            if not used:
                break
            self._pending = self._pending[used:]
            if pdu and address == (self._address or address):
                answer = self._answer(pdu)
                answer.dev_id, answer.transaction_id = address, transaction
                answers.append(self._framer.buildFrame(answer))
        if len(self._pending) > MAX_FRAME_BYTES:
            self._pending = b''
        return answers

    def _answer(self, pdu: bytes) -> ModbusPDU:
        request = self._framer.decoder.decode(pdu)
        if request is None:
            known = pdu[0] in (3, 6, 16)
            code = ExcCodes.ILLEGAL_VALUE if known else ExcCodes.ILLEGAL_FUNCTION
            return ExceptionResponse(pdu[0] & 0x7F, code)
        return self._registers.answer(request)
