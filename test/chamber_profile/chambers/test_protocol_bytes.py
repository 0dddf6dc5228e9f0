# SPDX-License-Identifier: Apache-2.0
"""ESPEC, ASCII-2 and SIMSERV: bytes as in the manufacturers' interface descriptions."""

from chamber_profile.emulators.espec import EspecServer
from chamber_profile.emulators.plant import EmulatedPlant
from chamber_profile.emulators.votsch import Ascii2Server, SimservServer

ESPEC_BYTES = [
    (b'TEMP?\r\n', 4),
    (b'MON?\r\n', 4),
    (b'ALARM?\r\n', 1),
]


def test_espec_answers_have_the_documented_fields() -> None:
    server = EspecServer(EmulatedPlant())
    for request, fields in ESPEC_BYTES:
        (answer,) = server.feed(request)
        assert answer.endswith(b'\r\n')
        assert len(answer.strip().split(b',')) == fields
    for order in (b'TEMP, S25.0', b'TEMP,S25', b'TEMP, S25.0 H100.0 L-40.0', b'MODE,CONSTANT'):
        assert server.feed(order + b'\r\n') == [b'OK:' + order + b'\r\n']
    assert server.feed(b'TEMP, S200.0\r\n') == [b'NA:DATA OUT OF RANGE\r\n']
    assert server.feed(b'COFFEE\r\n') == [b'NA:CMD ERR\r\n']
    assert server.feed(b'MO') == []
    assert server.feed(b'DE?\r\nALARM?\r\n') == [b'CONSTANT\r\n', b'0\r\n']


def test_espec_on_a_bus_answers_its_own_address_only() -> None:
    server = EspecServer(EmulatedPlant(), address=1)
    (answer,) = server.feed(b'1,MON?\r\n')
    assert answer.split(b',')[2] == b'STANDBY'
    assert server.feed(b'2,MON?\r\n') == []


def test_ascii2_uses_the_documented_number_format() -> None:
    server = Ascii2Server(EmulatedPlant())
    order = (
        b'$01E 0050.0 0080.0 0090.0 0000.0 0000.0 0000.0 0000.0 01000000000000000000000000000000\r'
    )
    assert server.feed(order) == [b'0\r']
    (image,) = server.feed(b'$01I\r')
    *values, bits = image.decode().split()
    assert len(values) == 14
    assert values[0] == '0050.0'
    assert {len(value) for value in values} == {6}
    assert bits == '01' + '0' * 30
    assert server.feed(b'$01U 0002.0 0000.0 0000.0 0000.0\r') == [b'0\r']
    assert server.feed(b'$02I\r') == []


def test_ascii2_writes_back_what_it_does_not_mean_to_change(emulator) -> None:
    chamber, _, _ = emulator('ascii2', 'tcp')
    chamber.connect()
    line = chamber._line
    sent = b'$01E 0020.0 0055.0 0090.0 0000.0 0001.0 0000.0 0003.0 001' + b'0' * 29 + b'\r'
    line.ask(sent, len)
    chamber.set_temperature(-7.5)
    chamber.run()
    values, bits = chamber._values()
    assert values[0] == -7.5
    assert values[2::2] == [55.0, 90.0, 0.0, 1.0, 0.0, 3.0]
    assert bits == '011' + '0' * 29


def test_simserv_frames() -> None:
    server = SimservServer(EmulatedPlant())
    s = b'\xb6'
    assert server.feed(s.join([b'11001', b'1', b'1', b'-10.0']) + b'\r') == [b'1\r\n']
    assert server.feed(s.join([b'11002', b'1', b'1']) + b'\r') == [b'1' + s + b'-10.0\r\n']
    assert server.feed(s.join([b'14001', b'1', b'1', b'1']) + b'\r') == [b'1\r\n']
    assert server.feed(s.join([b'10012', b'1']) + b'\r') == [b'1' + s + b'3\r\n']
    assert server.feed(s.join([b'12345', b'1']) + b'\r') == [b'-5\r\n']
    assert server.feed(s.join([b'11001', b'1', b'1', b'abc']) + b'\r') == [b'-6\r\n']
