# SPDX-License-Identifier: Apache-2.0
"""Both encodings against the test vectors of the firmware."""

from binascii import crc_hqx
from collections.abc import Iterator
from pathlib import Path

import pytest
from cobs import cobs
from imu_driver.board.lsm9ds1 import REGISTERS, register_set_up
from imu_driver.wire import ascii as ascii_frames
from imu_driver.wire import binary as binary_frames
from imu_driver.wire.codec import FrameDecoder
from imu_driver.wire.frames import (
    REGISTER_DUMP_BYTES,
    AcknowledgementFrame,
    CommandFrame,
    DataFrame,
    Frame,
    FrameError,
    InformationFrame,
)

VECTORS = Path(__file__).resolve().parents[3] / 'firmware' / 'test_vectors.txt'


def vectors(*kinds: str) -> Iterator[list[str]]:
    for line in VECTORS.read_text(encoding='ascii').splitlines():
        kind, *fields = line.split()
        if kind in kinds:
            yield [kind, *('' if field == '-' else field for field in fields)]


def frame_of(kind: str, fields: list[str]) -> Frame:
    if kind == 'data':
        numbers = [int(field) for field in fields]
        return DataFrame(*numbers[:4], tuple(numbers[4:]))
    if kind == 'command':
        return CommandFrame(*map(int, fields))
    if kind == 'acknowledgement':
        return AcknowledgementFrame(*map(int, fields))
    version, flags, tick, samples, serial_number, *rest = fields
    *numbers, who_am_i, registers = rest
    n = [int(number) for number in numbers]
    return InformationFrame(
        serial_number=serial_number,
        streaming=bool(int(flags) & 1),
        configuration=int(flags) >> 2,
        tick=int(tick),
        samples=int(samples),
        firmware=(n[0], n[1], n[2]),
        tick_rate=n[3],
        full_scale=(n[4], n[5], n[6]),
        output_data_rate=n[7],
        magnetometer_rate=n[8],
        i2c_errors=n[9],
        overruns=n[10],
        command_errors=n[11],
        supply_millivolts=n[12],
        who_am_i=tuple(bytes.fromhex(who_am_i)),
        registers=tuple(bytes.fromhex(registers)),
        version=int(version),
    )


FRAMES = list(vectors('data', 'command', 'acknowledgement', 'information'))


@pytest.mark.parametrize('vector', FRAMES, ids=lambda v: ' '.join(v)[:40])
def test_frames(vector: list[str]) -> None:
    kind, *fields, wire, line = vector
    frame = frame_of(kind, fields)
    assert binary_frames.encode(frame).hex() == wire
    assert binary_frames.decode(bytes.fromhex(wire)[:-1]) == frame
    assert ascii_frames.encode(frame) == line.encode() + b'\r\n'
    assert ascii_frames.decode(line.encode()) == frame


def test_a_data_frame_has_31_bytes_on_the_wire() -> None:
    assert {len(vector[-2]) for vector in FRAMES if vector[0] == 'data'} == {62}


def test_check_and_stuffing() -> None:
    for _, data, check in vectors('crc'):
        assert crc_hqx(bytes.fromhex(data), 0xFFFF) == int(check, 16)
    for _, data, encoded in vectors('cobs'):
        assert cobs.encode(bytes.fromhex(data)).hex() == encoded


@pytest.mark.parametrize('vector', list(vectors('reject')), ids=lambda v: v[2][:24])
def test_what_is_no_frame(vector: list[str]) -> None:
    _, kind, wire = vector
    with pytest.raises(FrameError) as caught:
        binary_frames.decode(bytes.fromhex(wire)[:-1])
    assert caught.value.kind == kind
    decoder = FrameDecoder('binary')
    assert decoder.feed(b'\0' + bytes.fromhex(wire)) == []
    assert getattr(decoder.counts, kind) == decoder.counts.errors == 1


def test_a_dump_holds_every_register() -> None:
    assert len(REGISTERS) == REGISTER_DUMP_BYTES


def test_register_set_up() -> None:
    for _, gyroscope, accelerometer, magnetometer, rate, magnetometer_rate, comp, dump in vectors(
        'registers'
    ):
        registers = register_set_up(
            {
                'gyroscope': float(gyroscope),
                'accelerometer': float(accelerometer),
                'magnetometer': float(magnetometer),
            },
            int(rate) / 1e3,
            magnetometer_rate=int(magnetometer_rate) / 1e3,
            magnetometer_temperature_compensation=comp == '1',
        )
        assert bytes(registers[name] for name in REGISTERS).hex() == dump
