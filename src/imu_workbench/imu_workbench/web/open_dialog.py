# SPDX-License-Identifier: Apache-2.0
"""Choose bags below the server's root."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

from nicegui import ui

from imu_workbench.web.bag_root import BagRoot


class OpenDialog:
    """A list of the bags there are, and a path to type."""

    def __init__(self, root: BagRoot, opened: Callable[[list[str]], Awaitable[None]]) -> None:
        self._root, self._opened = root, opened
        self._ticked: dict[Path, ui.checkbox] = {}
        with ui.dialog() as self._dialog, ui.element('div').classes('card dialog'):
            ui.html('<h2>Open bags</h2>', sanitize=False)
            ui.label(f'Below {root.folder}. One bag is one run; take all runs of a device.')
            self._list = ui.element('div').classes('bag-list')
            self._path = ui.input('or a path below it').props('dense outlined').classes('path')
            self._path.on('keydown.enter', self._open)
            with ui.row().classes('actions'):
                ui.button('Open', on_click=self._open).props('no-caps unelevated')
                ui.button('Cancel', on_click=self._dialog.close).props('no-caps flat')

    async def show(self) -> None:
        """Show the bags there are now."""
        self._dialog.open()
        bags = await asyncio.to_thread(self._root.bags)
        self._list.clear()
        self._ticked = {}
        with self._list:
            for bag in bags:
                self._ticked[bag] = ui.checkbox(self._root.name_of(bag)).props('dense')
            if not bags:
                ui.label('There are none.').classes('soft')

    async def _open(self) -> None:
        chosen = [str(bag) for bag, box in self._ticked.items() if box.value]
        if self._path.value.strip():
            chosen.append(self._path.value.strip())
        self._dialog.close()
        if chosen:
            await self._opened(chosen)
