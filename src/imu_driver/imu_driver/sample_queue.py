# SPDX-License-Identifier: Apache-2.0
"""Bounded queue between the reading and the publishing thread."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Final

from imu_driver.board.sample import Sample

CAPACITY: Final = 10_000
"""Samples: ten seconds at the highest rate."""


class SampleQueue:
    """Hands samples to `publish` in a thread of its own, in order, all that wait at once."""

    def __init__(self, publish: Callable[[list[Sample]], None]) -> None:
        self.fullest = 0
        """Most samples that ever waited."""
        self.overflowed = 0
        """Samples dropped because the publisher did not keep up."""
        self._publish = publish
        self._waiting: deque[list[Sample]] = deque()
        self._fill = 0
        self._wake = threading.Condition()
        self._open = True
        self._thread = threading.Thread(target=self._run, name='imu_publisher', daemon=True)

    @property
    def fill(self) -> float:
        """Share of the capacity in use."""
        return self._fill / CAPACITY

    @property
    def running(self) -> bool:
        """Whether the thread lives."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Begin to publish."""
        self._thread.start()

    def put(self, samples: list[Sample]) -> None:
        """Append samples; the oldest give way where there is no room."""
        if not samples:
            return
        with self._wake:
            self._waiting.append(samples)
            self._fill += len(samples)
            while self._fill > CAPACITY and len(self._waiting) > 1:
                oldest = self._waiting.popleft()
                self._fill -= len(oldest)
                self.overflowed += len(oldest)
            self.fullest = max(self.fullest, self._fill)
            self._wake.notify_all()

    def put_when_room(self, samples: list[Sample]) -> None:
        """Append samples, waiting for the publisher where there is no room."""
        with self._wake:
            self._wake.wait_for(lambda: self._fill + len(samples) <= CAPACITY or not self.running)
        self.put(samples)

    def stop(self) -> None:
        """Publish what waits and end."""
        with self._wake:
            self._open = False
            self._wake.notify_all()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._wake:
                while not self._waiting and self._open:
                    self._wake.wait()
                batches = list(self._waiting)
                self._waiting.clear()
                self._fill = 0
                self._wake.notify_all()
            if not batches:
                return
            for batch in batches:
                self._publish(batch)
