# SPDX-License-Identifier: Apache-2.0
"""Count Ctrl-C and SIGTERM instead of raising wherever the program happens to be.

A KeyboardInterrupt raised inside a message callback can surface as any error of the C++ layer
below; a node that counts interrupts finishes its callback and ends between two of them.
"""

from __future__ import annotations

import signal
import time

ONE_PRESS_S = 0.4
"""Ctrl-C reaches a launched node twice within this time: still one interrupt [s]."""
SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupts:
    """Counts SIGINT and SIGTERM from its construction on; close together they count once."""

    def __init__(self) -> None:
        self.count = 0
        self._last = float('-inf')
        for number in SIGNALS:
            signal.signal(number, self._on_signal)

    def ignore(self) -> None:
        """Let what follows (releasing devices, closing files) run to its end undisturbed."""
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)

    def _on_signal(self, *_: object) -> None:
        now = time.monotonic()
        if now - self._last > ONE_PRESS_S:
            self.count += 1
        self._last = now
