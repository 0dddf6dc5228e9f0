# SPDX-License-Identifier: Apache-2.0
"""Modbus, as much as a chamber needs: functions 3, 6 and 16, RTU and TCP. No I/O.

A PDU is function code and data; RTU puts the address before and a CRC behind it, TCP a header of
seven bytes before it.
"""

from __future__ import annotations

import struct

READ, WRITE, WRITE_MANY = 3, 6, 16
EXCEPTION = 0x80
REASONS = {1: 'illegal function', 2: 'illegal address', 3: 'illegal value', 4: 'device failure'}


class ModbusError(ValueError):
    """Bytes that are no answer to the request."""


class ModbusRefusalError(ValueError):
    """An exception answer; the message holds its reason."""


def crc16(data: bytes) -> int:
    """Return CRC-16/MODBUS.

    >>> hex(crc16(bytes.fromhex('010300640001')))
    '0xd5c5'
    """
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0xA001 if crc & 1 else 0)
    return crc


def read_pdu(register: int, count: int = 1) -> bytes:
    """Return the request for `count` holding registers."""
    return struct.pack('>BHH', READ, register, count)


def write_pdu(register: int, value: int) -> bytes:
    """Return the request to write one signed register."""
    return struct.pack('>BHh', WRITE, register, value)


def rtu_frame(address: int, pdu: bytes) -> bytes:
    """Return the frame on a serial line; the CRC's low byte goes first.

    >>> rtu_frame(1, write_pdu(300, 500)).hex(' ')
    '01 06 01 2c 01 f4 49 e8'
    """
    body = bytes([address]) + pdu
    return body + struct.pack('<H', crc16(body))


def tcp_frame(transaction: int, address: int, pdu: bytes) -> bytes:
    """Return the frame on TCP.

    >>> tcp_frame(1, 1, read_pdu(100)).hex(' ')
    '00 01 00 00 00 06 01 03 00 64 00 01'
    """
    return struct.pack('>HHHB', transaction, 0, len(pdu) + 1, address) + pdu


def rtu_answer_length(received: bytes) -> int:
    """Return the length of the RTU answer that begins so; 0: not yet known."""
    if len(received) < 3:
        return 0
    if received[1] & EXCEPTION:
        return 5
    return 5 + received[2] if received[1] == READ else 8


def tcp_answer_length(received: bytes) -> int:
    """Return the length of the TCP answer that begins so; 0: not yet known."""
    return 6 + int(struct.unpack('>H', received[4:6])[0]) if len(received) >= 6 else 0


def rtu_pdu(address: int, frame: bytes) -> bytes:
    """Return the PDU of an RTU frame; raise ModbusError where CRC or address are wrong."""
    if len(frame) < 4 or struct.unpack('<H', frame[-2:])[0] != crc16(frame[:-2]):
        raise ModbusError(f'CRC of {frame.hex(" ")} is wrong')
    if frame[0] != address:
        raise ModbusError(f'address {frame[0]} answered instead of {address}')
    return frame[1:-2]


def tcp_pdu(transaction: int, address: int, frame: bytes) -> bytes:
    """Return the PDU of a TCP frame; raise ModbusError where its header is wrong."""
    number, protocol, length, unit = struct.unpack('>HHHB', frame[:7])
    if (number, protocol, unit) != (transaction, 0, address) or length != len(frame) - 6:
        raise ModbusError(f'header {frame[:7].hex(" ")} does not belong to the request')
    return frame[7:]


def answer_values(request: bytes, answer: bytes) -> list[int]:
    """Return the registers an answer holds (none for a write); raise where it is no answer."""
    function = request[0]
    if answer[:1] == bytes([function | EXCEPTION]) and len(answer) == 2:
        raise ModbusRefusalError(REASONS.get(answer[1], f'exception {answer[1]}'))
    if function == READ:
        count = struct.unpack('>H', request[3:5])[0]
        if len(answer) == 2 + 2 * count and answer[:2] == bytes([READ, 2 * count]):
            return list(struct.unpack(f'>{count}h', answer[2:]))
    elif answer == request[:5]:
        return []
    raise ModbusError(f'{answer.hex(" ")} is no answer to {request.hex(" ")}')
