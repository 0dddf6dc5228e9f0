# SPDX-License-Identifier: Apache-2.0
r"""ASCII frames: one line each, `$KIND,field,…*CRC` (doc/wire_protocol.md).

>>> from imu_driver.wire.frames import CommandCode
>>> encode(CommandFrame(CommandCode.START, number=1))
b'$CMD,2,1,0*5FC6\r\n'
>>> decode(b'$CMD,2,1,0*5FC6')
CommandFrame(command=2, number=1, value=0)
"""

from __future__ import annotations

import re
from binascii import crc_hqx
from typing import Final

from imu_driver.wire.frames import (
    PROTOCOL_VERSION,
    REGISTER_DUMP_BYTES,
    STREAMING,
    AcknowledgementFrame,
    CommandFrame,
    DataFrame,
    Frame,
    FrameError,
    InformationFrame,
    OtherVersion,
    is_serial_number,
)

LONGEST_LINE_BYTES: Final = 255
"""No line of any version is longer, line end not counted."""

_LINE = re.compile(rb'\$([^$*]*)\*([0-9A-F]{4})')
_NUMBER = re.compile(rb'-?(0|[1-9][0-9]{0,9})')


def encode(frame: Frame) -> bytes:
    """Return the line, carriage return and line feed included."""
    body = _body(frame).encode('ascii')
    return b'$%s*%04X\r\n' % (body, crc_hqx(body, 0xFFFF))


def decode(line: bytes) -> Frame:
    """Return the frame of a line without its end; raise FrameError if it is none.

    Bytes before the last `$` are the rest of a damaged line and are ignored.
    """
    match = _LINE.fullmatch(line[max(line.rfind(b'$'), 0) :])
    if not match:
        raise FrameError('format')
    body, check = match.groups()
    if crc_hqx(body, 0xFFFF) != int(check, 16):
        raise FrameError('crc')
    kind, *fields = body.split(b',')
    try:
        return _READERS[kind](fields)
    except (KeyError, ValueError):
        raise FrameError('format') from None


def _body(frame: Frame) -> str:
    if isinstance(frame, DataFrame):
        head = f'IMU,{frame.sequence},{frame.tick},{frame.flags:X},{frame.temperature},'
        return head + ','.join(map(str, frame.counts))
    if isinstance(frame, AcknowledgementFrame):
        return 'ACK,' + ','.join(str(int(value)) for value in frame)
    if isinstance(frame, CommandFrame):
        return 'CMD,' + ','.join(str(int(value)) for value in frame)
    if isinstance(frame, OtherVersion):
        return f'INF,{frame.version}'
    flags = (STREAMING if frame.streaming else 0) | frame.configuration << 2
    numbers = (
        frame.tick_rate,
        *frame.full_scale,
        frame.output_data_rate,
        frame.magnetometer_rate,
        frame.i2c_errors,
        frame.overruns,
        frame.command_errors,
        frame.supply_millivolts,
    )
    return (
        f'INF,{frame.version},{flags:X},{frame.tick},{frame.samples},{frame.serial_number},'
        f'{".".join(map(str, frame.firmware))},{",".join(map(str, numbers))},'
        f'{bytes(frame.who_am_i).hex().upper()},{bytes(frame.registers).hex().upper()}'
    )


def _number(field: bytes, low: int, high: int) -> int:
    if not _NUMBER.fullmatch(field):
        raise ValueError(field)
    value = int(field)
    if not low <= value <= high:
        raise ValueError(field)
    return value


def _unsigned(field: bytes, bits: int) -> int:
    return _number(field, 0, (1 << bits) - 1)


def _data(fields: list[bytes]) -> Frame:
    sequence, tick, flags, temperature, *counts = fields
    if len(counts) != 9 or len(flags) != 1:
        raise ValueError(fields)
    return DataFrame(
        sequence=_unsigned(sequence, 16),
        tick=_unsigned(tick, 32),
        flags=int(flags, 16),
        temperature=_number(temperature, -32768, 32767),
        counts=tuple(_number(count, -32768, 32767) for count in counts),
    )


def _information(fields: list[bytes]) -> Frame:
    version = _unsigned(fields[0], 8)
    if version != PROTOCOL_VERSION:
        return OtherVersion(version)
    _, flags, tick, samples, serial_number, firmware, *numbers, who, registers = fields
    if not is_serial_number(serial_number) or len(numbers) != 10 or len(flags) != 1:
        raise ValueError(fields)
    major, minor, patch = (_unsigned(part, 8) for part in firmware.split(b'.'))
    widths = (32, 16, 8, 8, 32, 32, 32, 32, 32, 16)
    values = [_unsigned(field, bits) for field, bits in zip(numbers, widths, strict=True)]
    accelerometer_gyroscope, magnetometer = bytes.fromhex(who.decode('ascii'))
    dump = tuple(bytes.fromhex(registers.decode('ascii')))
    if len(dump) != REGISTER_DUMP_BYTES:
        raise ValueError(registers)
    return InformationFrame(
        serial_number=serial_number.decode('ascii'),
        streaming=bool(int(flags, 16) & STREAMING),
        configuration=int(flags, 16) >> 2,
        tick=_unsigned(tick, 32),
        samples=_unsigned(samples, 32),
        firmware=(major, minor, patch),
        tick_rate=values[0],
        full_scale=(values[1], values[2], values[3]),
        output_data_rate=values[4],
        magnetometer_rate=values[5],
        i2c_errors=values[6],
        overruns=values[7],
        command_errors=values[8],
        supply_millivolts=values[9],
        who_am_i=(accelerometer_gyroscope, magnetometer),
        registers=dump,
    )


def _acknowledgement(fields: list[bytes]) -> Frame:
    command, number, status, value = fields
    return AcknowledgementFrame(
        command=_unsigned(command, 8),
        number=_unsigned(number, 8),
        status=_unsigned(status, 8),
        value=_unsigned(value, 32),
    )


def _command(fields: list[bytes]) -> Frame:
    command, number, value = fields
    return CommandFrame(_unsigned(command, 8), _unsigned(number, 8), _unsigned(value, 32))


_READERS = {
    b'IMU': _data,
    b'INF': _information,
    b'ACK': _acknowledgement,
    b'CMD': _command,
}
