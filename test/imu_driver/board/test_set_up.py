# SPDX-License-Identifier: Apache-2.0
"""Set-up of a device: one command at a time, repeated until acknowledged, refusals remembered."""

import pytest
from imu_driver.board.set_up import (
    ACKNOWLEDGEMENT_TIMEOUT_NS,
    INFORMATION_INTERVAL_NS,
    MOST_TRIES,
    RETRY_PAUSE_NS,
    DeviceSetUp,
)
from imu_driver.wire.codec import FrameDecoder
from imu_driver.wire.frames import (
    REGISTER_DUMP_BYTES,
    AcknowledgementFrame,
    CommandCode,
    CommandFrame,
    InformationFrame,
    Status,
)

INFORMATION = InformationFrame(
    serial_number='A',
    streaming=False,
    configuration=0,
    tick=0,
    samples=0,
    firmware=(1, 0, 0),
    tick_rate=1_000_000,
    full_scale=(245, 2, 4),
    output_data_rate=238_000,
    magnetometer_rate=80_000,
    i2c_errors=0,
    overruns=0,
    command_errors=0,
    supply_millivolts=3300,
    who_am_i=(0x68, 0x3D),
    registers=(0,) * REGISTER_DUMP_BYTES,
)


def sent(set_up: DeviceSetUp, now: int) -> CommandFrame | None:
    """The command that goes out at a time, if any."""
    frames = FrameDecoder('binary').feed(set_up.outgoing(now, 'binary', known=True))
    assert len(frames) <= 1
    return frames[0] if frames else None


@pytest.fixture
def set_up() -> DeviceSetUp:
    """A set-up that has asked for information and got it."""
    new = DeviceSetUp({'accelerometer': 8.0}, 952.0, now=0)
    assert sent(new, 0) == CommandFrame(CommandCode.INFORMATION, 0)
    new.informed(INFORMATION, 1)
    return new


def acknowledge(set_up: DeviceSetUp, command: CommandFrame, status: Status = Status.DONE) -> str:
    return set_up.acknowledged(
        AcknowledgementFrame(command.command, command.number, status, command.value)
    )


def test_settings_that_differ_are_sent_one_by_one_and_then_the_start(set_up: DeviceSetUp) -> None:
    commands = []
    for now in range(2, 5):
        command = sent(set_up, now)
        assert command is not None
        assert sent(set_up, now) is None, 'the next waits for the acknowledgement'
        assert acknowledge(set_up, command) == ''
        commands.append((command.command, command.value))
    assert commands == [
        (CommandCode.ACCELEROMETER_FULL_SCALE, 8),
        (CommandCode.OUTPUT_DATA_RATE, 952_000),
        (CommandCode.START, 0),
    ]
    assert sent(set_up, 5) is None


def test_a_command_is_repeated_and_given_up_for_a_while(set_up: DeviceSetUp) -> None:
    first = sent(set_up, 2)
    for k in range(1, MOST_TRIES):
        assert sent(set_up, 2 + k * ACKNOWLEDGEMENT_TIMEOUT_NS - 1) is None
        assert sent(set_up, 2 + k * ACKNOWLEDGEMENT_TIMEOUT_NS) == first
    late = 2 + MOST_TRIES * ACKNOWLEDGEMENT_TIMEOUT_NS
    assert sent(set_up, late) is None
    set_up.stopped()
    assert sent(set_up, late) == CommandFrame(CommandCode.INFORMATION, 0)
    set_up.informed(INFORMATION, late + 1)
    assert sent(set_up, late + 2) is None, 'it pauses'
    set_up.informed(INFORMATION, late + RETRY_PAUSE_NS)
    again = sent(set_up, late + RETRY_PAUSE_NS)
    assert again is not None
    assert (again.command, again.value) == (first.command, first.value)


def test_a_refused_setting_is_named_and_not_sent_again(set_up: DeviceSetUp) -> None:
    command = sent(set_up, 2)
    told = acknowledge(set_up, command, Status.BAD_VALUE)
    assert told == (
        'the device did not set accelerometer full scale to 8: it does not have that value'
    )
    assert set_up.refused == {CommandCode.ACCELEROMETER_FULL_SCALE: told}
    for now in (3, 4):
        acknowledge(set_up, sent(set_up, now))
    set_up.informed(INFORMATION, 5)
    assert sent(set_up, 6).command == CommandCode.OUTPUT_DATA_RATE


def test_an_unknown_device_is_asked_in_both_encodings_at_intervals() -> None:
    new = DeviceSetUp({}, 0.0, now=0)
    chunk = new.outgoing(0, 'auto', known=False)
    for protocol in ('ascii', 'binary'):
        assert FrameDecoder(protocol).feed(chunk) == [CommandFrame(CommandCode.INFORMATION, 0)]
    assert new.outgoing(INFORMATION_INTERVAL_NS - 1, 'auto', known=False) == b''
    assert new.outgoing(INFORMATION_INTERVAL_NS, 'auto', known=False) == chunk
    new.give_up()
    assert new.outgoing(2 * INFORMATION_INTERVAL_NS, 'auto', known=False) == b''
