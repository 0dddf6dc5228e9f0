# SPDX-License-Identifier: Apache-2.0
"""The emulator as a process: its line, its log, its end, and its messages for wrong options."""

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from imu_driver.wire.binary import encode
from imu_driver.wire.codec import FrameDecoder
from imu_driver.wire.frames import CommandCode, CommandFrame, DataFrame, Frame, InformationFrame

PROGRAM = 'import sys; from imu_driver.emulator.emulated_device import main; sys.exit(main())'
COMMAND = [sys.executable, '-c', PROGRAM]
DEADLINE = 120.0


def frames_from(handle: int, decoder: FrameDecoder) -> Iterator[Frame]:
    end = time.monotonic() + DEADLINE
    while time.monotonic() < end:
        if select.select([handle], [], [], 0.1)[0]:
            try:
                chunk = os.read(handle, 4096)
            except OSError:
                chunk = b''
            if not chunk:  # the emulator has gone
                return
            yield from decoder.feed(chunk)
    raise AssertionError('nothing more came')


def test_its_log_tells_what_became_of_every_sample(tmp_path: Path) -> None:
    link, log, law = tmp_path / 'imu0', tmp_path / 'sent.json', tmp_path / 'law.csv'
    law.write_text('time_s,temperature_c\n0,-10\n100,-10\n')
    process = subprocess.Popen(
        [
            *COMMAND,
            *('--link', str(link), '--log', str(log), '--temperature', str(law), '--dut', 'dut2'),
            *('--rate', '476', '--fault', 'bit_flips@0+60'),
        ]
    )
    end = time.monotonic() + DEADLINE
    while not link.is_symlink():
        assert time.monotonic() < end
        assert process.poll() is None
        select.select([], [], [], 0.02)
    handle = os.open(link, os.O_RDWR | os.O_NOCTTY)
    decoder = FrameDecoder('binary')
    stream = frames_from(handle, decoder)
    os.write(handle, b'\0' + encode(CommandFrame(CommandCode.START, 1)))
    data: list[DataFrame] = []
    information: list[InformationFrame] = []
    for frame in stream:
        if isinstance(frame, DataFrame):
            data.append(frame)
        elif isinstance(frame, InformationFrame):
            information.append(frame)
        if len(data) == 700:
            process.send_signal(signal.SIGTERM)
    assert process.wait(DEADLINE) == 0
    os.close(handle)
    told = json.loads(log.read_text())
    received = {frame.sequence for frame in data}
    assert received.isdisjoint(told['damaged'])
    assert len(received) + len(told['damaged']) + told['dropped'] == told['sent']
    assert told['faults'] == [{'name': 'bit_flips', 'start': 0.0, 'end': 60.0}]
    assert information[-1].serial_number == 'DUT2'
    assert information[-1].output_data_rate == 476_000
    # The die is warmer than the air around it, by a few kelvins.
    assert -10.0 < 25.0 + data[-1].temperature / 16.0 < -4.0
    assert not link.exists()


@pytest.mark.parametrize(
    ('arguments', 'told'),
    [
        (['--link', '/nowhere/at/all/imu0'], '/nowhere/at/all'),
        (['--link', __file__], 'exists and is no link'),
        (['--link', 'x', '--fault', 'flood@3'], "fault 'flood@3'"),
        (['--link', 'x', '--rate', '0'], '--rate'),
        (['--link', 'x', '--dut', 'dut9'], 'dut9'),
        (['--link', 'x', '--temperature', 'no.csv'], 'no.csv'),
        (['--link', 'x', '--minimal'], '--protocol ascii'),
        (['--tcp', '70000'], '70000'),
    ],
)
def test_mistakes_end_in_one_line(
    arguments: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    from imu_driver.emulator.emulated_device import main

    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    try:
        assert main(arguments) == 2
    finally:
        signal.signal(signal.SIGTERM, before[0])
        signal.signal(signal.SIGINT, before[1])
    error = capsys.readouterr().err
    assert told in error
    assert error.count('\n') == 1
