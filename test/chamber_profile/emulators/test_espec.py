# SPDX-License-Identifier: Apache-2.0
"""The emulated ESPEC controller answers as the manufacturer's interface description says."""

from chamber_profile.emulators.espec import EspecServer
from chamber_profile.emulators.plant import EmulatedPlant

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
