# SPDX-License-Identifier: Apache-2.0
"""The reader's thread on a real pseudo-terminal and a real socket, through real unplugging."""

import select
import socket
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from emulation import StillDevice
from imu_driver.board.reader import DeviceReader
from imu_driver.board.session import DeviceSession, SessionConfig
from imu_driver.driver import TransportError, transport_opener
from imu_driver.emulator.board import BoardOptions, EmulatedBoard
from imu_driver.emulator.emulated_device import Emulator
from imu_driver.emulator.faults import Fault, FaultSchedule
from imu_driver.emulator.port import PtyPort, TcpPort

DEADLINE = 120.0


class Running:
    """An emulator and a reader, each in its thread, and a way to wait for what happens."""

    def __init__(self, url: str, port: Any, config: SessionConfig, protocol: str) -> None:
        self.changed = threading.Condition()
        self.samples: list[Any] = []
        self.events: list[str] = []
        self.schedule = FaultSchedule()
        board = EmulatedBoard(StillDevice(), BoardOptions(protocol=protocol))
        self.emulator = Emulator(board, port, self.schedule, now=time.monotonic)
        self.began = time.monotonic()
        self.session = DeviceSession(config)
        self.reader = DeviceReader(
            transport_opener(url, 921600),
            self.session,
            now=time.time_ns,
            deliver=lambda samples: self._append(self.samples, samples),
            report=lambda event: self._append(self.events, [event]),
        )
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _append(self, where: list[Any], what: list[Any]) -> None:
        with self.changed:
            where += what
            self.changed.notify_all()

    def _run(self) -> None:
        while not self._stop.is_set():
            wait = self.emulator.step()
            select.select(self.emulator.handles(), [], [], wait)
        self.emulator.close()

    def start(self) -> None:
        self._thread.start()
        self.reader.start()

    def stop(self) -> None:
        self.reader.stop()
        self._stop.set()
        self._thread.join()

    def fault(self, name: str, duration: float) -> None:
        now = time.monotonic() - self.began
        self.schedule.faults = (Fault(name, now, now + duration),)

    def wait(self, condition: Callable[[], bool]) -> None:
        with self.changed:
            assert self.changed.wait_for(condition, DEADLINE), self.events


def free_port() -> int:
    with socket.create_server(('127.0.0.1', 0)) as server:
        number: int = server.getsockname()[1]
        return number


@pytest.fixture(params=['pty binary', 'pty ascii', 'tcp binary'])
def running(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Running]:
    kind, protocol = request.param.split()
    config = SessionConfig(full_scale={'accelerometer': 4.0}, output_data_rate=476.0)
    if kind == 'pty':
        link = tmp_path / 'imu0'
        url, port = f'serial://{link}', PtyPort(link)
    else:
        number = free_port()
        url, port = f'tcp://127.0.0.1:{number}', TcpPort(number)
    both = Running(url, port, config, protocol)
    both.start()
    yield both
    both.stop()


def test_unplug_and_return(running: Running) -> None:
    running.wait(lambda: len(running.samples) > 50)
    assert running.session.nominal_rate == 476.0
    assert running.emulator.board.full_scale['accelerometer'] == 4.0
    running.fault('unplug', 0.3)
    running.wait(lambda: any('connection lost' in event for event in running.events))
    assert not running.reader.connected
    before = len(running.samples)
    running.wait(lambda: len(running.samples) > before + 50)
    assert running.reader.reconnects == 1
    stamps = [sample.stamp for sample in running.samples]
    assert all(a < b for a, b in pairwise(stamps))
    gaps = [(b - a) * 1e-9 for a, b in pairwise(stamps)]
    assert 0.3 <= max(gaps) < 2.3
    # On a busy machine samples are lost before and after as well.
    missing = sum(round(gap * 476.0) - 1 for gap in gaps)
    assert running.session.sequence.lost == pytest.approx(missing, rel=0.1)
    for sample in running.samples:
        assert sample.linear_acceleration == pytest.approx((0.5, -0.3, 9.79), abs=0.01)


def test_exchange_for_another_board(running: Running) -> None:
    running.wait(lambda: len(running.samples) > 50)
    running.fault('other_serial', 1.0)
    running.wait(lambda: 'device DUT1-OTHER took the place of DUT1' in running.events)
    running.wait(lambda: 'device DUT1 took the place of DUT1-OTHER' in running.events)
    before = len(running.samples)
    running.wait(lambda: len(running.samples) > before + 50)
    assert running.session.nominal_rate == 476.0, 'the one that returned is set up again'


def test_a_port_is_held_alone(tmp_path: Path) -> None:
    port = PtyPort(tmp_path / 'imu0')
    port.plug()
    open_it = transport_opener(f'serial://{tmp_path / "imu0"}', 921600)
    first = open_it()
    with pytest.raises(OSError, match='imu0'):
        open_it()
    first.close()
    open_it().close()
    port.pull()
    with pytest.raises(OSError, match='imu0'):
        open_it()


@pytest.mark.parametrize(
    'url', ['', '/dev/ttyACM0', 'serial://', 'tcp://host', 'usb://x', 'tcp://a:b']
)
def test_a_transport_that_cannot_be_is_named(url: str) -> None:
    with pytest.raises(TransportError, match='expected serial:///dev'):
        transport_opener(url, 921600)


def test_what_comes_within_the_read_period_is_delivered_together_and_complete() -> None:
    """About ten samples of 952 Hz to a read; where samples are rarer than reads none waits."""
    batches: list[list[Any]] = []
    changed = threading.Condition()

    def deliver(samples: list[Any]) -> None:
        with changed:
            batches.append(samples)
            changed.notify_all()

    session = DeviceSession(SessionConfig())
    reader = DeviceReader(
        transport_opener('simulated://dut1', 921600, 952.0),
        session,
        now=time.time_ns,
        deliver=deliver,
        report=lambda _: None,
        read_period=0.01,
    )
    reader.start()
    with changed:
        assert changed.wait_for(lambda: sum(map(len, batches)) > 1000, DEADLINE)
    reader.stop()
    stamps = [sample.stamp for batch in batches for sample in batch]
    assert all(earlier < later for earlier, later in pairwise(stamps))
    assert session.sequence.lost == 0
    assert len(batches) < len(stamps) / 5


def test_nothing_is_stamped_before_the_clock_begins(tmp_path: Path) -> None:
    link = tmp_path / 'imu0'
    running = Running(f'serial://{link}', PtyPort(link), SessionConfig(), 'binary')
    begun = threading.Event()
    asked: list[int] = []

    def now() -> int:
        asked.append(0)
        return time.time_ns() if begun.is_set() else 0

    running.reader._now = now
    running.start()
    give_up = time.monotonic() + DEADLINE
    while len(asked) < 50 and time.monotonic() < give_up:
        time.sleep(0.01)
    assert len(asked) >= 50
    assert not running.samples
    first = time.time_ns()
    begun.set()
    running.wait(lambda: len(running.samples) > 100)
    running.stop()
    assert min(sample.stamp for sample in running.samples) > first - 1_000_000_000
