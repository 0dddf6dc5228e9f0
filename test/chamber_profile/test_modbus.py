# SPDX-License-Identifier: Apache-2.0
"""Modbus: own frames and pymodbus' are those of the interface description, byte for byte."""

import pytest
from chamber_profile.chambers import modbus
from chamber_profile.chambers.catalogue import ChamberAddressError, open_chamber
from chamber_profile.chambers.chamber import ChamberError, ChamberRefusalError
from chamber_profile.chambers.line import Line
from chamber_profile.chambers.modbus_line import ModbusLine, PymodbusLine
from chamber_profile.emulators.plant import EmulatedBody
from chamber_profile.emulators.watlow_f4 import WatlowRtuServer

FRAMES = {
    'read PV': (modbus.read_pdu(100), '01 03 00 64 00 01 C5 D5'),
    'read decimals': (modbus.read_pdu(606), '01 03 02 5E 00 01 E4 60'),
    'SP = 50.0': (modbus.write_pdu(300, 500), '01 06 01 2C 01 F4 49 E8'),
    'SP = -10.0': (modbus.write_pdu(300, -100), '01 06 01 2C FF 9C 08 66'),
    'event 1 on': (modbus.write_pdu(2000, 1), '01 06 07 D0 00 01 48 87'),
    'terminate': (modbus.write_pdu(1217, 1), '01 06 04 C1 00 01 18 C6'),
    'start profile 1': (
        bytes.fromhex('10 0FA0 0003 06 0001 0001 0005'),
        '01 10 0F A0 00 03 06 00 01 00 01 00 05 7C 15',
    ),
    'status': (modbus.read_pdu(200), '01 03 00 C8 00 01 05 F4'),
}


@pytest.mark.parametrize('name', FRAMES)
def test_modbus_frames_are_those_of_the_notes_byte_for_byte(name: str) -> None:
    pdu, frame = FRAMES[name]
    assert modbus.rtu_frame(1, pdu) == bytes.fromhex(frame)


@pytest.mark.parametrize(
    ('request_pdu', 'answer', 'values'),
    [
        (modbus.read_pdu(100), '01 03 02 FF 97 B8 1A', [-105]),
        (modbus.read_pdu(606), '01 03 02 00 01 79 84', [1]),
        (modbus.write_pdu(300, 500), '01 06 01 2C 01 F4 49 E8', []),
    ],
)
def test_modbus_answers_of_the_notes_are_understood(request_pdu, answer: str, values) -> None:
    frame = bytes.fromhex(answer)
    assert modbus.rtu_answer_length(frame[:3]) == len(frame)
    assert modbus.answer_values(request_pdu, modbus.rtu_pdu(1, frame)) == values


def test_modbus_exceptions_wrong_crc_and_wrong_address() -> None:
    frame = bytes.fromhex('01 83 02 C0 F1')
    with pytest.raises(modbus.ModbusRefusalError, match='illegal address'):
        modbus.answer_values(modbus.read_pdu(9), modbus.rtu_pdu(1, frame))
    with pytest.raises(modbus.ModbusError, match='CRC'):
        modbus.rtu_pdu(1, bytes.fromhex('01 83 02 C0 F0'))
    with pytest.raises(modbus.ModbusError, match='address 1'):
        modbus.rtu_pdu(2, frame)
    tcp = modbus.tcp_frame(1, 1, modbus.read_pdu(100))
    assert tcp.hex(' ') == '00 01 00 00 00 06 01 03 00 64 00 01'


def test_the_emulated_f4_answers_the_frames_of_the_notes() -> None:
    server = WatlowRtuServer(EmulatedBody())
    for name in ('SP = 50.0', 'SP = -10.0', 'event 1 on', 'terminate'):
        frame = bytes.fromhex(FRAMES[name][1])
        assert server.feed(frame[:5]) == []
        assert server.feed(frame[5:]) == [frame]
    assert server.feed(bytes.fromhex('01 03 02 5E 00 01 E4 60')) == [
        bytes.fromhex('01 03 02 00 01 79 84')
    ]
    unknown = modbus.rtu_frame(1, modbus.read_pdu(9))
    assert server.feed(unknown) == [bytes.fromhex('01 83 02 C0 F1')]


class Answering:
    """A line on which every request gets the same answer; keeps what was sent."""

    def __init__(self, answer: str = '') -> None:
        self.answer = bytes.fromhex(answer)
        self.sent: list[bytes] = []

    def close(self) -> None:
        """Nothing is open."""

    def ask(self, request: bytes, length) -> bytes:
        self.sent.append(request)
        return self.answer[: length(self.answer)]


@pytest.mark.parametrize('name', FRAMES)
def test_pymodbus_makes_the_frames_of_the_notes_byte_for_byte(name: str) -> None:
    pdu, frame = FRAMES[name]
    assert PymodbusLine(Line('none'), 1, tcp=False).frame(pdu) == bytes.fromhex(frame)
    tcp = PymodbusLine(Line('none'), 1, tcp=True).frame(pdu, 7)
    assert tcp == modbus.tcp_frame(7, 1, pdu)


KINDS = [ModbusLine, PymodbusLine]


@pytest.mark.parametrize('kind', KINDS)
def test_both_read_the_answers_of_the_notes(kind) -> None:
    wire = Answering('01 03 02 FF 97 B8 1A')
    assert kind(wire, 1, tcp=False).read(100) == [-105]
    assert wire.sent == [bytes.fromhex('01 03 00 64 00 01 C5 D5')]
    wire = Answering('01 06 01 2C FF 9C 08 66')
    kind(wire, 1, tcp=False).write(300, -100)
    assert wire.sent == [wire.answer]
    wire = Answering('00 01 00 00 00 05 01 03 02 FF 97')
    assert kind(wire, 1, tcp=True).read(100) == [-105]


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize(
    ('answer', 'tcp', 'error'),
    [
        ('01 83 02 C0 F1', False, ChamberRefusalError),
        ('01 03 02 FF 97 B8 1B', False, ChamberError),  # CRC
        ('02 03 02 FF 97 FC 1A', False, ChamberError),  # another address
        ('01 06 01 2C 01 F4 49 E8', False, ChamberError),  # another function
        ('01 03 04 00 01 00 02 2A 32', False, ChamberError),  # more than was asked for
        ('00 09 00 00 00 05 01 03 02 FF 97', True, ChamberError),  # another transaction
        ('00 01 00 00 00 03 01 83 02', True, ChamberRefusalError),
    ],
)
def test_both_refuse_what_is_no_answer(kind, answer: str, tcp: bool, error) -> None:
    with pytest.raises(ChamberError) as caught:
        kind(Answering(answer), 1, tcp=tcp).read(100)
    assert type(caught.value) is error


@pytest.mark.parametrize('wire', ['tcp', 'serial'])
def test_an_f4_is_driven_with_pymodbus(emulator, wire: str) -> None:
    chamber, body, clock = emulator('watlow_f4', wire, 'bad_crc@10+5', options='?pymodbus=1')
    assert isinstance(chamber._registers, PymodbusLine)
    assert 'EMULATED' in chamber.connect()
    chamber.set_limits(-15.0, 55.0)
    assert body.chamber.limits == (-15.0, 55.0)
    chamber.set_temperature(-10.0)
    chamber.run()
    assert chamber.read().setpoint == -10.0
    assert chamber.read().running
    with pytest.raises(ChamberRefusalError, match='illegal value'):
        chamber.set_temperature(100.0)
    chamber._registers.line.timeout_s = 0.15
    clock[0] = 11.0
    if wire == 'serial':  # TCP has no checksum of its own
        with pytest.raises(ChamberError):
            chamber.read()


def test_without_pymodbus_the_option_says_what_to_do(monkeypatch) -> None:
    monkeypatch.setattr('chamber_profile.chambers.catalogue.find_spec', lambda _: None)
    with pytest.raises(ChamberAddressError, match=r'chamber_profile\[pymodbus\]'):
        open_chamber('watlow_f4+tcp://localhost:502?pymodbus=1')
    assert open_chamber('watlow_f4+tcp://localhost:502')
