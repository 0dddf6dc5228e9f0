# SPDX-License-Identifier: Apache-2.0
"""Binary frames: payload, CRC-16/CCITT-FALSE, COBS, zero delimiter (doc/wire_protocol.md).

>>> from imu_driver.wire.frames import CommandCode
>>> wire = encode(CommandFrame(CommandCode.START, number=1))
>>> wire.hex(' ')
'04 40 02 01 01 01 01 03 0d 33 00'
>>> decode(wire[:-1])
CommandFrame(command=2, number=1, value=0)
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from typing import Final

from cobs import cobs

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

DATA: Final = 0x10
INFORMATION: Final = 0x20
ACKNOWLEDGEMENT: Final = 0x30
COMMAND: Final = 0x40

DELIMITER: Final = b'\0'
LONGEST_FRAME_BYTES: Final = 255
"""No frame of any version is longer, delimiter not counted."""

_DATA = struct.Struct('<BHIh9h')
_INFORMATION = struct.Struct(f'<BBBII16s3BIHBBIIIIIHBB{REGISTER_DUMP_BYTES}s')
_ACKNOWLEDGEMENT = struct.Struct('<BBBBI')
_COMMAND = struct.Struct('<BBBI')


def encode(frame: Frame) -> bytes:
    """Return the bytes on the wire, delimiter included."""
    payload = _payload(frame)
    # The check goes most significant byte first, so that the check of the whole is zero.
    encoded: bytes = cobs.encode(payload + crc_hqx(payload, 0xFFFF).to_bytes(2, 'big'))
    return encoded + DELIMITER


def decode(encoded: bytes) -> Frame:
    """Return the frame of the bytes between two delimiters; raise FrameError if it is none."""
    try:
        checked = cobs.decode(encoded)
    except cobs.DecodeError:
        raise FrameError('cobs') from None
    if len(checked) < 3 or crc_hqx(checked, 0xFFFF):
        raise FrameError('crc')
    payload = checked[:-2]
    kind = payload[0] & 0xF0
    try:
        if kind == DATA:
            first, sequence, tick, temperature, *counts = _DATA.unpack(payload)
            return DataFrame(
                sequence=sequence,
                tick=tick,
                flags=first & 0x0F,
                temperature=temperature,
                counts=tuple(counts),
            )
        if kind == INFORMATION:
            return _information(payload)
        if kind == ACKNOWLEDGEMENT:
            return AcknowledgementFrame(*_ACKNOWLEDGEMENT.unpack(payload)[1:])
        if kind == COMMAND:
            return CommandFrame(*_COMMAND.unpack(payload)[1:])
    except struct.error:
        raise FrameError('format') from None
    raise FrameError('format')


def _payload(frame: Frame) -> bytes:
    if isinstance(frame, DataFrame):
        return _DATA.pack(
            DATA | frame.flags, frame.sequence, frame.tick, frame.temperature, *frame.counts
        )
    if isinstance(frame, AcknowledgementFrame):
        return _ACKNOWLEDGEMENT.pack(ACKNOWLEDGEMENT, *frame)
    if isinstance(frame, CommandFrame):
        return _COMMAND.pack(COMMAND, *frame)
    if isinstance(frame, OtherVersion):
        return bytes([INFORMATION, frame.version])
    gyroscope, accelerometer, magnetometer = frame.full_scale
    return _INFORMATION.pack(
        INFORMATION,
        frame.version,
        (STREAMING if frame.streaming else 0) | frame.configuration << 2,
        frame.tick,
        frame.samples,
        frame.serial_number.encode('ascii'),
        *frame.firmware,
        frame.tick_rate,
        gyroscope,
        accelerometer,
        magnetometer,
        frame.output_data_rate,
        frame.magnetometer_rate,
        frame.i2c_errors,
        frame.overruns,
        frame.command_errors,
        frame.supply_millivolts,
        *frame.who_am_i,
        bytes(frame.registers),
    )


def _information(payload: bytes) -> Frame:
    if len(payload) > 1 and payload[1] != PROTOCOL_VERSION:
        return OtherVersion(payload[1])
    fields = _INFORMATION.unpack(payload)
    serial_number = fields[5].rstrip(b'\0')
    if not is_serial_number(serial_number):
        raise FrameError('format')
    return InformationFrame(
        serial_number=serial_number.decode('ascii'),
        streaming=bool(fields[2] & STREAMING),
        configuration=fields[2] >> 2 & 3,
        tick=fields[3],
        samples=fields[4],
        firmware=fields[6:9],
        tick_rate=fields[9],
        full_scale=fields[10:13],
        output_data_rate=fields[13],
        magnetometer_rate=fields[14],
        i2c_errors=fields[15],
        overruns=fields[16],
        command_errors=fields[17],
        supply_millivolts=fields[18],
        who_am_i=fields[19:21],
        registers=tuple(fields[21]),
    )
