# SPDX-License-Identifier: Apache-2.0
"""What changes at once is drawn once; what changes while it is drawn, once more."""

from __future__ import annotations

import asyncio
from contextlib import nullcontext

from imu_workbench.web.redraw import Redraw
from nicegui import background_tasks, core


def test_several_changes_are_drawn_once_and_those_meanwhile_once_more(monkeypatch):
    async def play() -> list[str]:
        monkeypatch.setattr(core, 'loop', asyncio.get_running_loop())
        drawn: list[str] = []
        begun, goes_on = asyncio.Event(), asyncio.Event()

        async def draw() -> None:
            drawn.append('begun')
            begun.set()
            await goes_on.wait()
            drawn.append('done')

        redraw = Redraw(nullcontext(), draw)
        redraw()
        redraw()
        await begun.wait()
        assert drawn == ['begun']
        redraw()
        redraw()
        goes_on.set()
        await asyncio.gather(*background_tasks.running_tasks)
        return drawn

    assert asyncio.run(play()) == ['begun', 'done'] * 2
