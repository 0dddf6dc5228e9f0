# SPDX-License-Identifier: Apache-2.0
"""Which of several devices is answered first: one that somebody looks at."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Callable, Collection, Hashable
from contextlib import asynccontextmanager

CORES = os.cpu_count() or 1


class AnswerOrder:
    """Order of the work on devices: those a tab shows at once, others when these are answered."""

    def __init__(
        self, devices: Callable[[], Collection[str]], asked: Callable[[], Collection[str]]
    ) -> None:
        """`devices`: all there are, the first is shown first; `asked`: those without an answer."""
        self._devices, self._asked = devices, asked
        self._looked_at: dict[Hashable, str] = {}
        self._running: list[str] = []
        self._waiting: list[asyncio.Future[None]] = []

    def look(self, tab: Hashable, device: str) -> None:
        """Remember which device a tab shows."""
        if self._looked_at.get(tab) != device:
            self._looked_at[tab] = device
            self.changed()

    def leave(self, tab: Hashable) -> None:
        """Forget a tab that was closed."""
        self._looked_at.pop(tab, None)
        self.changed()

    def changed(self) -> None:
        """Let those that wait see whether it is their turn."""
        for waiting in self._waiting:
            if not waiting.done():
                waiting.set_result(None)
        self._waiting = []

    @asynccontextmanager
    async def turn(self, *devices: str) -> AsyncIterator[str]:
        """Wait for the turn of any of these devices; yield which it is."""
        while (device := self._next(devices)) is None:
            self._waiting.append(asyncio.get_running_loop().create_future())
            await self._waiting[-1]
        self._running.append(device)
        try:
            yield device
        finally:
            self._running.remove(device)
            self.changed()

    def _next(self, devices: Collection[str]) -> str | None:
        seen = {*self._looked_at.values()} or {*list(self._devices())[:1]}
        first = next((device for device in devices if device in seen), None)
        if first is not None:
            return first
        awaited = seen & {*self._running, *self._asked()}
        return None if awaited or len(self._running) >= CORES else next(iter(devices))
