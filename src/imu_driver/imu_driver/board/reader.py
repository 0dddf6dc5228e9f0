# SPDX-License-Identifier: Apache-2.0
"""The thread that reads one device: open the line, read and answer, open it again after a loss."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Final

from imu_driver.board.sample import Sample
from imu_driver.board.session import DeviceSession, WarningEvent
from imu_driver.board.transport import Transport

FIRST_RETRY_S: Final = 0.2
"""[s] Pause after the first failed attempt to open the line; it doubles with each."""
LONGEST_RETRY_S: Final = 1.0
"""[s] Longest pause between two attempts."""
ASK_AFTER_SILENCE_S: Final = 1.0
"""[s] A device that has sent nothing for this long is asked for information."""
REOPEN_AFTER_SILENCE_S: Final = 5.0
"""[s] A line on which nothing came for this long is closed and opened again."""
LEAST_SAMPLES_PER_READ: Final = 1.5
"""Samples within `read_period` from which reads are that far apart."""


class DeviceReader:
    """Reads a device: samples go to `deliver`, events for the operator to `report`."""

    def __init__(
        self,
        open_transport: Callable[[], Transport],
        session: DeviceSession,
        *,
        now: Callable[[], int],
        deliver: Callable[[list[Sample]], None],
        report: Callable[[str], None],
        read_period: float = 0.0,
    ) -> None:
        self.session = session
        self.read_period = read_period
        """[s] Shortest time between two reads where more than one sample arrives in it."""
        self.connected = False
        self.connections = 0
        self.connection_error = 'not opened yet'
        """Why there is no connection; '' while there is one."""
        self._open = open_transport
        self._now = now
        self._deliver = deliver
        self._report = report
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='imu_reader', daemon=True)

    @property
    def reconnects(self) -> int:
        """How often the line was opened again after it had been lost."""
        return max(self.connections - 1, 0)

    @property
    def running(self) -> bool:
        """Whether the thread lives."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def stop(self) -> None:
        """End reading and release the line."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        retry = FIRST_RETRY_S
        while not self._stop.is_set():
            try:
                transport = self._open()
            except OSError as error:
                self._set_connection_error(f'{error} (trying again)')
                self._stop.wait(retry)
                retry = min(2.0 * retry, LONGEST_RETRY_S)
                continue
            retry = FIRST_RETRY_S
            self.connections += 1
            self.connected = True
            self._set_connection_error('')
            try:
                self._converse(transport)
            except OSError as error:
                self._set_connection_error(f'connection lost: {error}')
            finally:
                self.connected = False
                transport.close()
                self._deliver(self.session.disconnected())
            self._stop.wait(retry)

    def _converse(self, transport: Transport) -> None:
        session = self.session
        heard = self._now()
        session.connected(heard)
        while not self._stop.is_set():
            chunk = transport.read()
            now, began = self._now(), time.monotonic()
            if chunk and now:  # a simulated clock that has not begun: nothing can be stamped
                heard = now
                samples = session.feed(chunk, now)
                if samples:
                    self._deliver(samples)
                if session.events:
                    self._report_events()
            elif now - heard > REOPEN_AFTER_SILENCE_S * 1e9:
                raise TimeoutError(f'no byte received for {REOPEN_AFTER_SILENCE_S:g} s')
            elif now - heard > ASK_AFTER_SILENCE_S * 1e9:
                session.ask(now)
            outgoing = session.outgoing(now)
            if outgoing:
                transport.write(outgoing)
            if chunk and self.read_period * session.nominal_rate > LEAST_SAMPLES_PER_READ:
                time.sleep(max(began + self.read_period - time.monotonic(), 0.0))

    def _report_events(self) -> None:
        for event in self.session.events:
            self._report(event)
        self.session.events.clear()

    def _set_connection_error(self, error: str) -> None:
        if error != self.connection_error:
            self._report(WarningEvent(error) if error else 'connected')
        self.connection_error = error
