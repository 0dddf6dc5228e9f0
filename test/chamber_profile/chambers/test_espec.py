# SPDX-License-Identifier: Apache-2.0
"""The ESPEC driver sends and reads the lines of the manufacturer's interface description."""

import pytest
from chamber_profile.chambers.chamber import ChamberError, ChamberReading, ChamberRefusalError
from chamber_profile.chambers.espec import EspecChamber
from recorded_line import RecordedLine


def chamber(*exchanges: tuple[bytes, bytes], address: int = 0) -> EspecChamber:
    return EspecChamber(RecordedLine(*exchanges), address)


def test_a_reading_asks_for_temperatures_state_and_only_then_for_alarms() -> None:
    calm = chamber((b'TEMP?\r\n', b'23.0,20.0,100.0,-40.0\r\n'),
                   (b'MON?\r\n', b'24.1,55,CONSTANT,0\r\n'))  # fmt: skip
    assert calm.read() == ChamberReading(23.0, 20.0, running=True, humidity=0.55)
    alarmed = chamber((b'TEMP?\r\n', b'26.4,0.0,140.0,-50.0\r\n'),
                      (b'MON?\r\n', b'26.4,,STANDBY,2\r\n'),
                      (b'ALARM?\r\n', b'2,4,19\r\n'))  # fmt: skip
    reading = alarmed.read()
    assert reading.alarms == ('4', '19')
    assert not reading.running
    assert reading.humidity is None


def test_orders_are_echoed_and_an_address_goes_before_them() -> None:
    bus = chamber((b'1,TEMP, S-10.0\r\n', b'OK:TEMP, S-10.0\r\n'), address=1)
    bus.set_temperature(-10.0)
    off = chamber((b'MODE?\r\n', b'OFF\r\n'), (b'POWER,ON\r\n', b'OK:POWER,ON\r\n'),
                  (b'MODE,CONSTANT\r\n', b'OK:MODE,CONSTANT\r\n'))  # fmt: skip
    off.run()
    assert off._line.exchanges == []


@pytest.mark.parametrize(
    ('high', 'low', 'taken'), [(b'30.0', b'10.0', True), (b'100.0', b'-40.0', False)]
)
def test_limits_keep_the_set_point_inside_and_are_read_back(
    high: bytes, low: bytes, taken: bool
) -> None:
    order = b'TEMP, S30.0 H30.0 L10.0'
    limited = chamber(
        (b'TEMP?\r\n', b'23.0,50.0,100.0,-40.0\r\n'),
        (order + b'\r\n', b'OK:' + order + b'\r\n'),
        (b'TEMP?\r\n', b'23.0,30.0,' + high + b',' + low + b'\r\n'),
    )
    if taken:
        limited.set_limits(10.0, 30.0)
    else:
        with pytest.raises(ChamberRefusalError, match='limits are -40 … 100 °C, not 10 … 30 °C'):
            limited.set_limits(10.0, 30.0)


@pytest.mark.parametrize(
    ('answer', 'error', 'words'),
    [
        (b'NA:DATA OUT OF RANGE\r\n', ChamberRefusalError, 'DATA OUT OF RANGE'),
        (b'OK:TEMP, S21.0\r\n', ChamberError, 'answered'),  # another order's echo
        (b'\xff\xfe\r\n', ChamberError, 'answered'),
        (b'OK:TEMP, S20.0', ChamberError, 'no answer'),  # cut
    ],
)
def test_what_is_no_echo_is_an_error(answer: bytes, error: type, words: str) -> None:
    with pytest.raises(ChamberError, match=words) as caught:
        chamber((b'TEMP, S20.0\r\n', answer)).set_temperature(20.0)
    assert type(caught.value) is error
