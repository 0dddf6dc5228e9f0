# SPDX-License-Identifier: Apache-2.0
"""The drivers of Weiss and Vötsch chambers send and read the documented strings."""

import pytest
from chamber_profile.chambers.chamber import ChamberError, ChamberRefusalError
from chamber_profile.chambers.votsch import Ascii2Chamber, Layout, SimservChamber
from recorded_line import RecordedLine

IMAGE = (
    b'0050.0 0024.6 0080.0 0066.7 0090.0 0090.0 0000.0 0023.8 0000.0 0022.2 0000.0 0025.5 '
    b'0000.0 0024.4 01100000000000000000000000000000\r'
)
"""The documented answer to `$01I`."""


def test_the_documented_image_is_understood() -> None:
    reading = Ascii2Chamber(RecordedLine((b'$01I\r', IMAGE))).read()
    assert (reading.setpoint, reading.air, reading.humidity) == (50.0, 24.6, 0.667)
    assert reading.running
    assert reading.alarms == ()
    alarmed = Ascii2Chamber(RecordedLine((b'$01I\r', IMAGE)), layout=Layout(alarm_bit=2))
    assert alarmed.read().alarms == ('alarm bit',)


def test_a_start_sends_all_set_values_and_one_more_bit() -> None:
    stopped = IMAGE.replace(b' 01100', b' 00100')
    order = (
        b'$01E 0050.0 0080.0 0090.0 0000.0 0000.0 0000.0 0000.0 01100000000000000000000000000000\r'
    )
    Ascii2Chamber(RecordedLine((b'$01I\r', stopped), (order, b'0\r'))).run()
    refusing = Ascii2Chamber(RecordedLine((b'$01I\r', stopped), (order, b'1\r')))
    with pytest.raises(ChamberRefusalError, match='ASCII-2 refused'):
        refusing.run()


def test_an_image_of_another_layout_is_an_error_that_names_the_expected_one() -> None:
    chamber = Ascii2Chamber(RecordedLine((b'$01I\r', IMAGE)), layout=Layout(n_read=16))
    with pytest.raises(ChamberError, match='n_read=16'):
        chamber.read()


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


S = b'\xb6'


def test_simserv_reads_and_writes_with_its_documented_numbers() -> None:
    line = RecordedLine(
        (S.join([b'10012', b'1']) + b'\r', b'1' + S + b'3\r\n'),
        (S.join([b'11004', b'1', b'1']) + b'\r', b'1' + S + b'23.4\r\n'),
        (S.join([b'11002', b'1', b'1']) + b'\r', b'1' + S + b'-10.0\r\n'),
        (S.join([b'11001', b'1', b'1', b'-10.0']) + b'\r', b'1\r\n'),
        (S.join([b'14001', b'1', b'1', b'1']) + b'\r', b'1\r\n'),
    )
    chamber = SimservChamber(line)
    reading = chamber.read()
    assert (reading.air, reading.setpoint, reading.running) == (23.4, -10.0, True)
    chamber.set_temperature(-10.0)
    chamber.run()
    assert line.exchanges == []


@pytest.mark.parametrize(
    ('answer', 'error'),
    [(b'-5\r\n', ChamberRefusalError), (b'-8\r\n', ChamberRefusalError), (b'7\r\n', ChamberError)],
)
def test_simserv_refusals_and_nonsense_are_told_apart(answer: bytes, error: type) -> None:
    chamber = SimservChamber(RecordedLine((S.join([b'14001', b'1', b'1', b'0']) + b'\r', answer)))
    with pytest.raises(ChamberError) as caught:
        chamber.stop()
    assert type(caught.value) is error
