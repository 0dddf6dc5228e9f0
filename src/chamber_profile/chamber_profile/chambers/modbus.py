# SPDX-License-Identifier: Apache-2.0
"""Holding registers over Modbus RTU or TCP: the frames are pymodbus', the bytes go over a `Line`.

pymodbus' own clients are not used: whatever goes wrong (no answer, wrong CRC, another address or
transaction, half an answer), they wait for the whole time-out and report "No response received".
"""

from __future__ import annotations

import logging

from pymodbus.constants import ExcCodes
from pymodbus.framer import FramerBase, FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, WriteSingleRegisterRequest

from chamber_profile.chambers.chamber import ChamberError, ChamberRefusalError
from chamber_profile.chambers.line import Line

logging.getLogger('pymodbus').addHandler(logging.NullHandler())  # errors are raised, not logged


def framer(*, tcp: bool, is_server: bool) -> FramerBase:
    """Return what puts PDUs into frames and takes them out again."""
    return (FramerSocket if tcp else FramerRTU)(DecodePDU(is_server))


class ModbusRegisters:
    """Signed 16-bit holding registers of a controller; function codes 3 and 6."""

    def __init__(self, line: Line, address: int, *, tcp: bool) -> None:
        self.line = line
        self.address = address
        self._framer = framer(tcp=tcp, is_server=False)
        self._tcp = tcp
        self._transaction = 0

    def open(self) -> None:
        """Open the line (again)."""
        self.line.open()

    def close(self) -> None:
        """Close the line."""
        self.line.close()

    def read(self, register: int, count: int = 1) -> list[int]:
        """Return `count` registers from `register` on."""
        answer = self._exchange(ReadHoldingRegistersRequest(address=register, count=count))
        return [value - 0x10000 if value & 0x8000 else value for value in answer.registers]

    def write(self, register: int, value: int) -> None:
        """Write one register."""
        self._exchange(WriteSingleRegisterRequest(address=register, registers=[value & 0xFFFF]))

    def _exchange(self, request: ModbusPDU) -> ModbusPDU:
        """Return the answer to a request; raise ChamberError where what comes is none."""
        if self._tcp:
            self._transaction = self._transaction % 0xFFFF + 1
        request.dev_id, request.transaction_id = self.address, self._transaction
        frame = self._framer.buildFrame(request)
        raw = self.line.ask(frame, lambda received: int(self._framer.decode(received)[0]))
        try:
            return self._answer(request, raw)
        except ChamberRefusalError:
            raise
        except ChamberError:
            self.close()
            raise

    def _answer(self, request: ModbusPDU, raw: bytes) -> ModbusPDU:
        _, address, transaction, data = self._framer.decode(raw)
        if not data:
            raise ChamberError(f'CRC of {raw.hex(" ")} is wrong')
        if address != self.address:
            raise ChamberError(f'address {address} answered instead of {self.address}')
        if transaction != request.transaction_id:
            raise ChamberError(
                f'transaction {transaction} was answered instead of {request.transaction_id}'
            )
        answer = self._framer.decoder.decode(data)
        refused = isinstance(answer, ExceptionResponse)
        if refused and answer.function_code == request.function_code | 0x80:
            raise ChamberRefusalError(f'refused {_shown(request)}: {_reason(answer)}')
        if answer is None or not _belongs(answer, request) or _pdu(answer) != data:
            raise ChamberError(f'{data.hex(" ")} is no answer to {_shown(request)}')
        return answer


def _belongs(answer: ModbusPDU, request: ModbusPDU) -> bool:
    """Whether an answer is to the request: same function, all registers, the value written."""
    if isinstance(request, ReadHoldingRegistersRequest):
        same_function = answer.function_code == request.function_code
        return bool(same_function and len(answer.registers) == request.count)
    return _pdu(answer) == _pdu(request)


def _pdu(message: ModbusPDU) -> bytes:
    return bytes([message.function_code]) + bytes(message.encode())


def _shown(request: ModbusPDU) -> str:
    return _pdu(request).hex(' ')


def _reason(answer: ExceptionResponse) -> str:
    code = int(answer.exception_code)
    known = code in ExcCodes.__members__.values()
    return ExcCodes(code).name.lower().replace('_', ' ') if known else f'exception {code}'
