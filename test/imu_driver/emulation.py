# SPDX-License-Identifier: Apache-2.0
"""Emulated board, line and session on one simulated clock, without threads or waiting."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from imu_driver.board.lsm9ds1 import AXIS_SIGNS, DEFAULT_FULL_SCALE, SENSITIVITY, SENSORS
from imu_driver.board.reader import FIRST_RETRY_S
from imu_driver.board.sample import Sample
from imu_driver.board.session import DeviceSession, SessionConfig
from imu_driver.emulator.board import BoardOptions, EmulatedBoard
from imu_driver.emulator.emulated_device import Emulator
from imu_driver.emulator.faults import FaultSchedule, parse_fault

EPOCH = 1_700_000_000_000_000_000
TRUTH = {
    'gyroscope': (0.01, -0.02, 0.03),
    'accelerometer': (0.5, -0.3, 9.79),
    'magnetometer': (2.2e-5, -1.1e-5, -4.0e-5),
}


class StillDevice:
    """Counts of a device at rest; the last bit follows time so that frames differ."""

    rate_factor = 1.0

    def __init__(self) -> None:
        self.full_scale = dict(DEFAULT_FULL_SCALE)

    def sample(self, time: float, ambient: float) -> Any:
        counts = []
        for sensor in SENSORS:
            step = SENSITIVITY[sensor][self.full_scale[sensor]]
            dither = math.sin(1e3 * time)
            counts.append(
                tuple(
                    round(sign * value / step + dither)
                    for value, sign in zip(TRUTH[sensor], AXIS_SIGNS[sensor], strict=True)
                )
            )
        return (*counts, round((ambient - 25.0) * 16))


class MemoryPort:
    """A plug whose other end is in this process."""

    def __init__(self) -> None:
        self.present = False
        self.to_host = bytearray()
        self.to_board = bytearray()
        self.opened = 0

    def plug(self) -> None:
        self.present = True
        self.opened += 1

    def pull(self) -> None:
        self.present = False
        self.to_host.clear()
        self.to_board.clear()

    def handles(self) -> list[int]:
        return []

    def read(self) -> bytes:
        data = bytes(self.to_board)
        self.to_board.clear()
        return data

    def write(self, data: bytes) -> int:
        self.to_host += data
        return len(data)

    @property
    def unread(self) -> int:
        return len(self.to_host)


@dataclass
class Emulation:
    """Board, line and session; `run` advances the clock."""

    options: BoardOptions = field(default_factory=BoardOptions)
    config: SessionConfig = field(default_factory=SessionConfig)
    faults: tuple[str, ...] = ()
    tick: float = 1e-3
    on_samples: Callable[[list[Sample]], None] | None = None

    def __post_init__(self) -> None:
        schedule = FaultSchedule([parse_fault(fault) for fault in self.faults])
        if any(fault.startswith('tick_wrap') for fault in self.faults):
            self.options = BoardOptions(
                protocol=self.options.protocol, first_tick=schedule.first_tick()
            )
        self.time = 0.0
        self.host_ahead = 0.0
        self.port = MemoryPort()
        self.source = StillDevice()
        self.board = EmulatedBoard(self.source, self.options)
        self.emulator = Emulator(self.board, self.port, schedule, now=lambda: self.time)
        self.session = DeviceSession(self.config)
        self.samples: list[Sample] = []
        self.events: list[str] = []
        self.connections = 0
        self._open = 0
        self._retry_at = 0.0

    @property
    def line(self) -> Any:
        return self.emulator.line

    def ns(self) -> int:
        return EPOCH + round((self.time + self.host_ahead) * 1e9)

    def run(self, until: float) -> None:
        while self.time < until:
            self.emulator.step()
            self._host()
            self.time = round(self.time + self.tick, 9)

    def finish(self) -> None:
        self.emulator.finish()
        self._host()

    def _host(self) -> None:
        port, session = self.port, self.session
        if self._open and (not port.present or port.opened != self._open):
            self._open = 0
            self.samples += session.disconnected()
            self._retry_at = self.time + FIRST_RETRY_S
        if not self._open and port.present and self.time >= self._retry_at:
            self._open = port.opened
            self.connections += 1
            port.to_host.clear()
            session.connected(self.ns())
        if not self._open:
            return
        if port.to_host:
            samples = session.feed(bytes(port.to_host), self.ns())
            port.to_host.clear()
            if self.on_samples:
                self.on_samples(samples)
            else:
                self.samples += samples
        port.to_board += session.outgoing(self.ns())
        self.events += session.events
        session.events.clear()
