# SPDX-License-Identifier: Apache-2.0
"""Registers over a line: Modbus RTU or TCP in frames of our own, or of pymodbus (optional).

Our own need pyserial only and read any answer strictly; pymodbus, where it is installed, is the
second opinion. Both make the same bytes.
"""

from __future__ import annotations

from typing import Any, Protocol

from chamber_profile.chambers import modbus
from chamber_profile.chambers.chamber import ChamberError, ChamberRefusalError
from chamber_profile.chambers.line import Line


class Registers(Protocol):
    """Signed 16-bit registers of a controller."""

    def open(self) -> None:
        """Open the line (again)."""

    def close(self) -> None:
        """Close the line."""

    def read(self, register: int, count: int = 1) -> list[int]:
        """Return registers in a row."""

    def write(self, register: int, value: int) -> None:
        """Write one register."""


class ModbusLine:
    """Registers in frames of our own."""

    def __init__(self, line: Line, address: int, *, tcp: bool) -> None:
        self.line = line
        self.address = address
        self.tcp = tcp
        self._transaction = 0

    def open(self) -> None:
        """Open the line (again)."""
        self.line.open()

    def close(self) -> None:
        """Close the line."""
        self.line.close()

    def read(self, register: int, count: int = 1) -> list[int]:
        """Return registers in a row."""
        return self._exchange(modbus.read_pdu(register, count))

    def write(self, register: int, value: int) -> None:
        """Write one register."""
        self._exchange(modbus.write_pdu(register, value))

    def number(self) -> int:
        """Return the number of the next transaction (TCP)."""
        self._transaction = self._transaction % 0xFFFF + 1
        return self._transaction

    def ask(self, frame: bytes) -> bytes:
        """Return the whole frame that answers a frame."""
        length = modbus.tcp_answer_length if self.tcp else modbus.rtu_answer_length
        return self.line.ask(frame, length)

    def _exchange(self, request: bytes) -> list[int]:
        try:
            if self.tcp:
                number = self.number()
                raw = self.ask(modbus.tcp_frame(number, self.address, request))
                answer = modbus.tcp_pdu(number, self.address, raw)
            else:
                raw = self.ask(modbus.rtu_frame(self.address, request))
                answer = modbus.rtu_pdu(self.address, raw)
            return modbus.answer_values(request, answer)
        except modbus.ModbusRefusalError as error:
            raise ChamberRefusalError(f'refused {request.hex(" ")}: {error}') from error
        except modbus.ModbusError as error:
            self.close()
            raise ChamberError(str(error)) from error


class PymodbusLine(ModbusLine):
    """Registers in frames that pymodbus makes and reads."""

    def __init__(self, line: Line, address: int, *, tcp: bool) -> None:
        super().__init__(line, address, tcp=tcp)
        from pymodbus.framer import FramerRTU, FramerSocket
        from pymodbus.pdu import DecodePDU

        self._framer = (FramerSocket if tcp else FramerRTU)(DecodePDU(False))

    def frame(self, request: bytes, number: int = 0) -> bytes:
        """Return the frame of a request's PDU."""
        from pymodbus.pdu import DecodePDU

        message = DecodePDU(True).decode(request)
        message.dev_id, message.transaction_id = self.address, number
        return bytes(self._framer.buildFrame(message))

    def _exchange(self, request: bytes) -> list[int]:
        from pymodbus.exceptions import ModbusException

        number = self.number() if self.tcp else 0
        raw = self.ask(self.frame(request, number))
        try:
            _, answer = self._framer.handleFrame(raw, self.address, number)
        except ModbusException as error:
            answer, raw = None, f'{raw.hex(" ")} ({error})'.encode()
        if answer is not None and answer.isError():
            reason = modbus.REASONS.get(answer.exception_code, str(answer))
            raise ChamberRefusalError(f'refused {request.hex(" ")}: {reason}')
        if answer is None or not _answers(request, answer):
            self.close()
            raise ChamberError(f'{raw!r} is no answer to {request.hex(" ")}')
        if request[0] != modbus.READ:
            return []
        return [value - 0x10000 if value & 0x8000 else value for value in answer.registers]


def _answers(request: bytes, answer: Any) -> bool:
    """Return whether an answer belongs to the request: same function, all registers."""
    if answer.function_code != request[0]:
        return False
    if request[0] == modbus.READ:
        return len(answer.registers) == int.from_bytes(request[3:5], 'big')
    return bytes([request[0]]) + bytes(answer.encode()) == request[:5]
