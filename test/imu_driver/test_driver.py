# SPDX-License-Identifier: Apache-2.0
"""What comes while a sample is published waits in the line: none is lost, all in order."""

import os
import threading
import time
import tty

from imu_driver.board.sample import Sample
from imu_driver.driver import DriverParameters, ImuDriver
from imu_driver.emulator.board import BoardOptions
from imu_driver.emulator.transport import emulated_board

DEADLINE = 120.0
SPAN = 0.5
"""[s] at the highest rate: less than a serial port keeps."""


def test_a_publisher_that_hangs_loses_nothing() -> None:
    free, hanging = threading.Event(), threading.Event()
    complete = threading.Event()
    published: list[Sample] = []
    board = emulated_board('dut1', BoardOptions(output_data_rate=952.0))

    def publish(samples: list[Sample]) -> None:
        hanging.set()
        assert free.wait(DEADLINE)
        published.extend(samples)
        if len(published) == board.samples and board_time >= began + SPAN:
            complete.set()

    device, line = os.openpty()
    tty.setraw(line)
    parameters = DriverParameters(transport=f'serial://{os.ttyname(line)}')
    driver = ImuDriver(parameters, now=time.time_ns, publish=publish, report=lambda _: None)
    driver.start()
    board_time = began = 0.0
    os.set_blocking(device, False)

    def advance() -> None:
        nonlocal board_time
        board_time += 0.004
        try:
            board.receive(os.read(device, 4096), board_time)
        except BlockingIOError:
            time.sleep(1e-3)
        for sent in board.advance(board_time):
            assert os.write(device, sent.data) == len(sent.data)

    while not hanging.is_set():
        advance()
    began = board_time
    while board_time < began + SPAN:
        advance()
    free.set()
    assert complete.wait(DEADLINE)
    driver.stop()
    os.close(device)
    os.close(line)
    assert driver.session is not None
    assert driver.session.sequence.lost == 0
    stamps = [sample.stamp for sample in published]
    assert stamps == sorted(stamps)
    assert len(stamps) > SPAN * 952.0
