# SPDX-License-Identifier: Apache-2.0
"""Days of frames through the driver node in minutes: what benchmarks/driver.py asks of memory."""

from __future__ import annotations

import gc
import os
import statistics
import time
from pathlib import Path

import rclpy
from imu_driver.emulator.board import BoardOptions
from imu_driver.emulator.transport import emulated_board
from imu_driver.node import ImuDriverNode

EPOCH = 1_700_000_000_000_000_000


def resident_bytes() -> int:
    return int(Path('/proc/self/statm').read_text().split()[1]) * os.sysconf('SC_PAGE_SIZE')


class PacedByThePublisher:
    """A transport that makes frames as fast as they are published; time is theirs."""

    def __init__(self, frames: int, rate: float = 952.0) -> None:
        self.board = emulated_board('dut1', BoardOptions(output_data_rate=rate))
        self.frames = frames
        self.step = 8.0 / rate
        self.time = 0.0

    def now(self) -> int:
        return EPOCH + round(self.time * 1e9)

    def read(self) -> bytes:
        if self.board.samples >= self.frames:
            time.sleep(0.01)
            return b''
        self.time += self.step
        return b''.join(sent.data for sent in self.board.advance(self.time))

    def write(self, data: bytes) -> None:
        self.board.receive(data, self.time)

    def close(self) -> None:
        pass


def soak(frames: int = 1_300_000) -> dict[str, float]:
    """Growth of memory from the first tenth to the end."""
    rclpy.init()
    transport = PacedByThePublisher(frames)
    node = ImuDriverNode(now=transport.now, parameters={'transport': 'simulated://dut1'})
    node.trigger_configure()
    node._prepared._reader._open = lambda: transport
    began = time.monotonic()
    node.trigger_activate()
    sizes: list[int] = []
    while (published := node.driver.statistics.published) < frames - 1000:
        rclpy.spin_once(node, timeout_sec=0.2)
        if published > frames / 10:
            sizes.append(resident_bytes())
    took = time.monotonic() - began
    lost = node.driver.session.sequence.lost
    wraps = node.driver.session.clock.wraps
    node.trigger_deactivate()
    node.destroy_node()
    rclpy.try_shutdown()
    gc.collect()
    tenth = max(len(sizes) // 10, 1)
    grown = statistics.median(sizes[-tenth:]) - statistics.median(sizes[:tenth])
    return {
        'frames': published,
        'lost': lost,
        'frames_per_second': published / took,
        'growth_mb': grown / 1e6,
        'simulated_hours': transport.time / 3600,
        'tick_wraps': wraps,
    }
