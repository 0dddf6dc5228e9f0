# SPDX-License-Identifier: Apache-2.0
"""A thread that calls one function periodically."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


class PeriodicThread:
    """Calls `step` every `period_s` until stopped; after a late step no step is caught up.

    Where a step raises, `failed` is called before the error ends the thread.
    """

    def __init__(
        self, step: Callable[[], None], period_s: float, failed: Callable[[], None]
    ) -> None:
        self._step = step
        self._period = period_s
        self._failed = failed
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name='run', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread and wait for it."""
        self._stop.set()
        if self._thread is not threading.current_thread():
            self._thread.join()

    def _work(self) -> None:
        due = time.monotonic()
        while not self._stop.wait(max(due - time.monotonic(), 0.0)):
            due = max(due + self._period, time.monotonic())
            try:
                self._step()
            except Exception:
                self._failed()
                raise
