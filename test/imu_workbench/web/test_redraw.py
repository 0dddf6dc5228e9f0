# SPDX-License-Identifier: Apache-2.0
"""What changes at once is drawn once; what changes while it is drawn, once more."""

from __future__ import annotations

import asyncio
from contextlib import nullcontext

from imu_workbench.web.redraw import Redraw
from nicegui import core


def test_several_changes_are_drawn_once_and_those_meanwhile_once_more(monkeypatch):
    drawn: list[str] = []

    async def play() -> None:
        monkeypatch.setattr(core, 'loop', asyncio.get_running_loop())
        goes_on = asyncio.Event()

        async def draw() -> None:
            drawn.append('begun')
            await goes_on.wait()
            drawn.append('done')

        redraw = Redraw(nullcontext(), draw)
        redraw()
        redraw()
        await asyncio.sleep(0.01)
        assert drawn == ['begun']
        redraw()
        redraw()
        goes_on.set()
        await asyncio.sleep(0.01)

    asyncio.run(play())
    assert drawn == ['begun', 'done'] * 2
