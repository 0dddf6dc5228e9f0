# SPDX-License-Identifier: Apache-2.0
"""Emulated Weiss and Vötsch chambers answer as the interface descriptions say."""

from chamber_profile.emulators.plant import EmulatedPlant
from chamber_profile.emulators.votsch import Ascii2Server, SimservServer


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


def test_simserv_frames() -> None:
    server = SimservServer(EmulatedPlant())
    s = b'\xb6'
    assert server.feed(s.join([b'11001', b'1', b'1', b'-10.0']) + b'\r') == [b'1\r\n']
    assert server.feed(s.join([b'11002', b'1', b'1']) + b'\r') == [b'1' + s + b'-10.0\r\n']
    assert server.feed(s.join([b'14001', b'1', b'1', b'1']) + b'\r') == [b'1\r\n']
    assert server.feed(s.join([b'10012', b'1']) + b'\r') == [b'1' + s + b'3\r\n']
    assert server.feed(s.join([b'12345', b'1']) + b'\r') == [b'-5\r\n']
    assert server.feed(s.join([b'11001', b'1', b'1', b'abc']) + b'\r') == [b'-6\r\n']
