# SPDX-License-Identifier: Apache-2.0
"""Modbus on the wire: bytes of the specification and of the F4's notes, and every fault."""

import sys

import pytest
from chamber_profile.chambers.catalogue import open_chamber
from chamber_profile.chambers.chamber import ChamberError, ChamberRefusalError
from chamber_profile.chambers.modbus import ModbusRegisters
from chamber_profile.chambers.protocol import ChamberAddressError
from chamber_profile.emulators.plant import EmulatedPlant
from chamber_profile.emulators.watlow_f4 import WatlowF4Server


class Answering:
    """A line on which requests get one answer, in pieces; keeps what was sent."""

    def __init__(self, answer: str = '', piece: int = 300) -> None:
        self.answer = bytes.fromhex(answer)
        self.piece = piece
        self.sent: list[bytes] = []
        self.closed = 0

    def close(self) -> None:
        self.closed += 1

    def ask(self, request: bytes, length) -> bytes:
        self.sent.append(request)
        for end in range(self.piece, len(self.answer) + self.piece, self.piece):
            received = self.answer[:end]
            if (size := length(received)) and len(received) >= size:
                return received[:size]
        raise ChamberError(f'no answer, got {self.answer!r}')


def registers(wire: Answering, address: int = 1, *, tcp: bool = False) -> ModbusRegisters:
    return ModbusRegisters(wire, address, tcp=tcp)


# MODBUS Application Protocol V1.1b3, sections 6.3 and 6.6, in frames of the serial line (V1.02:
# address before, CRC-16 with its low byte first behind) and of TCP (V1.0b: seven bytes before).
READ_107 = '03 00 6B 00 03'
READ_107_ANSWER = '03 06 02 2B 00 00 00 64'
WRITE_1 = '06 00 01 00 03'


def crc16(body: bytes) -> bytes:
    """CRC-16 of the serial line as its appendix B writes it: bit by bit, low byte first."""
    crc = 0xFFFF
    for byte in body:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0xA001 if crc & 1 else 0)
    return crc.to_bytes(2, 'little')


def serial_frame(pdu: str, address: int = 0x11) -> str:
    body = bytes([address]) + bytes.fromhex(pdu)
    return (body + crc16(body)).hex(' ')


def tcp_frame(pdu: str, address: int = 0x11, transaction: int = 1) -> str:
    data = bytes.fromhex(pdu)
    header = (transaction, 0, len(data) + 1)
    return (b''.join(n.to_bytes(2, 'big') for n in header) + bytes([address]) + data).hex(' ')


def test_the_crc_is_that_of_the_specifications_example() -> None:
    assert crc16(bytes.fromhex('02 07')) == bytes.fromhex('41 12')


@pytest.mark.parametrize(('frame', 'tcp'), [(serial_frame, False), (tcp_frame, True)])
@pytest.mark.parametrize('piece', [1, 3, 300])
def test_requests_and_answers_are_those_of_the_specification(frame, tcp: bool, piece: int) -> None:
    wire = Answering(frame(READ_107_ANSWER), piece)
    assert registers(wire, 0x11, tcp=tcp).read(0x6B, 3) == [0x022B, 0, 100]
    assert wire.sent == [bytes.fromhex(frame(READ_107))]
    wire = Answering(frame(WRITE_1), piece)
    registers(wire, 0x11, tcp=tcp).write(1, 3)
    assert wire.sent == [bytes.fromhex(frame(WRITE_1))]


F4_REQUESTS = {
    'read PV': (100, None, '01 03 00 64 00 01 C5 D5'),
    'read decimals': (606, None, '01 03 02 5E 00 01 E4 60'),
    'status': (200, None, '01 03 00 C8 00 01 05 F4'),
    'SP = 50.0': (300, 500, '01 06 01 2C 01 F4 49 E8'),
    'SP = -10.0': (300, -100, '01 06 01 2C FF 9C 08 66'),
    'event 1 on': (2000, 1, '01 06 07 D0 00 01 48 87'),
    'terminate': (1217, 1, '01 06 04 C1 00 01 18 C6'),
}


@pytest.mark.parametrize('name', F4_REQUESTS)
def test_requests_are_those_of_the_f4s_notes(name: str) -> None:
    register, value, frame = F4_REQUESTS[name]
    if value is None:
        wire = Answering('01 03 02 FF 97 B8 1A')
        assert registers(wire).read(register) == [-105]
    else:
        wire = Answering(frame)  # the answer repeats the request
        registers(wire).write(register, value)
    assert wire.sent == [bytes.fromhex(frame)]


def test_transactions_on_tcp_are_numbered_and_never_zero() -> None:
    wire = Answering(tcp_frame(WRITE_1))
    line = registers(wire, 0x11, tcp=True)
    line.write(1, 3)
    line._transaction = 0xFFFF
    line.write(1, 3)
    assert [sent[:2] for sent in wire.sent] == [b'\0\1', b'\0\1']


FAULTS = [
    ('01 83 02 C0 F1', False, 'refused 03 00 64 00 01: illegal address'),
    ('00 01 00 00 00 03 01 83 02', True, 'refused 03 00 64 00 01: illegal address'),
    ('00 01 00 00 00 03 01 83 06', True, 'device busy'),
    ('00 01 00 00 00 03 01 83 63', True, 'exception 99'),
    ('01 03 02 FF 97 B8 1B', False, 'CRC of 01 03 02 ff 97 b8 1b is wrong'),
    (serial_frame('03 02 FF 97', 2), False, 'address 2 answered instead of 1'),
    ('01 06 01 2C 01 F4 49 E8', False, '06 01 2c 01 f4 is no answer to 03 00 64 00 01'),
    (serial_frame('03 04 00 01 00 02', 1), False, '03 04 00 01 00 02 is no answer to'),
    (serial_frame('86 02', 1), False, '86 02 is no answer to'),  # refuses what was not asked
    ('00 09 00 00 00 05 01 03 02 FF 97', True, 'transaction 9 was answered instead of 1'),
    ('00 01 00 00 00 05 02 03 02 FF 97', True, 'address 2 answered instead of 1'),
    ('00 01 00 00 00 06 01 03 02 FF 97 00', True, 'is no answer to 03 00 64 00 01'),
    ('00 01 00 00 00 05 01 03 03 FF 97', True, 'is no answer to 03 00 64 00 01'),
    ('01 03 02 FF', False, 'no answer, got'),  # cut
    ('00 01 00 00 00 05 01 03 02', True, 'no answer, got'),
    ('00 01 00 07 00 05 01 03 02 FF 97', True, 'no answer, got'),  # another protocol
]


@pytest.mark.parametrize(('answer', 'tcp', 'words'), FAULTS)
@pytest.mark.parametrize('piece', [1, 300])
def test_what_is_no_answer_is_named(answer: str, tcp: bool, words: str, piece: int) -> None:
    wire = Answering(answer, piece)
    with pytest.raises(ChamberError) as caught:
        registers(wire, tcp=tcp).read(100)
    assert words in str(caught.value)
    refused = 'refused' in words or 'exception' in words or 'busy' in words
    assert isinstance(caught.value, ChamberRefusalError) == refused
    if 'got' not in words:  # the line closes itself where nothing whole comes
        assert wire.closed == (0 if refused else 1)


def test_an_order_that_is_answered_with_another_value_was_not_taken() -> None:
    with pytest.raises(ChamberError, match='06 01 2c 01 f5 is no answer to 06 01 2c 01 f4'):
        registers(Answering(serial_frame('06 01 2C 01 F5', 1))).write(300, 500)


def test_the_emulated_f4_answers_the_frames_of_the_notes() -> None:
    server = WatlowF4Server(EmulatedPlant())
    for name in ('SP = 50.0', 'SP = -10.0', 'event 1 on', 'terminate'):
        frame = bytes.fromhex(F4_REQUESTS[name][2])
        assert server.feed(frame[:5]) == []
        assert server.feed(frame[5:]) == [frame]
    assert server.feed(bytes.fromhex('01 03 02 5E 00 01 E4 60')) == [
        bytes.fromhex('01 03 02 00 01 79 84')
    ]


EXCHANGES = [
    ('03 00 09 00 01', '83 02'),  # no such register
    ('03 00 64 00 7E', '83 03'),  # more than 125 registers
    ('06 01 2C 27 10', '86 03'),  # 1000 °C
    ('06 00 19 00 00', '86 02'),
    ('10 02 5A 00 02 04 FF 6A 02 26', '10 02 5A 00 02'),  # both limits at once
    ('10 02 5A 00 02 02 FF 6A', '90 03'),
    ('01 00 00 00 01', '81 01'),  # coils
    ('04 00 64 00 01', '84 01'),
]


@pytest.mark.parametrize('tcp', [False, True])
@pytest.mark.parametrize(('request_pdu', 'answer_pdu'), EXCHANGES)
def test_the_emulated_f4_answers_and_refuses_as_the_specification_says(
    request_pdu: str, answer_pdu: str, tcp: bool
) -> None:
    frame = tcp_frame if tcp else serial_frame
    server = WatlowF4Server(EmulatedPlant(), tcp=tcp)
    request, answer = (bytes.fromhex(frame(pdu, 1)) for pdu in (request_pdu, answer_pdu))
    assert server.feed(request) == [answer]


def test_the_emulated_f4_is_silent_to_others_and_recovers_from_garbage() -> None:
    server = WatlowF4Server(EmulatedPlant())
    good = bytes.fromhex(F4_REQUESTS['read decimals'][2])
    assert server.feed(bytes.fromhex(serial_frame('03 02 5E 00 01', 2))) == []
    assert server.feed(good[:-1] + b'\0') == []  # CRC
    assert server.feed(good) == [bytes.fromhex('01 03 02 00 01 79 84')]
    assert server.feed(300 * b'\x7f') == []
    assert server.feed(good) == [bytes.fromhex('01 03 02 00 01 79 84')]


def test_a_pymodbus_that_is_missing_or_too_old_is_named(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, 'chamber_profile.chambers.modbus', None)
    with pytest.raises(ChamberAddressError, match=r'pymodbus 3\.11 or later'):
        open_chamber('watlow_f4+tcp://localhost:502')
