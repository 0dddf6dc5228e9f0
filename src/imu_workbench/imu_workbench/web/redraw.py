# SPDX-License-Identifier: Apache-2.0
"""Redraws a part of the page soon after a change, once for several changes."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextlib import AbstractContextManager
from typing import Any

from nicegui import background_tasks


class Redraw:
    """Draws once for changes at the same time, and once more for those while it draws."""

    def __init__(
        self, client: AbstractContextManager[Any], draw: Callable[[], Awaitable[None]]
    ) -> None:
        """`client`: the browser tab that `draw` draws in."""
        self._client, self._draw = client, draw
        self._stale, self._drawing = False, False

    def __call__(self) -> None:
        """Draw soon."""
        self._stale = True
        if not self._drawing:
            self._drawing = True
            background_tasks.create(self._run(), name='draw the page')

    async def _run(self) -> None:
        try:
            while self._stale:
                self._stale = False
                with self._client:
                    await self._draw()
        finally:
            self._drawing = False
