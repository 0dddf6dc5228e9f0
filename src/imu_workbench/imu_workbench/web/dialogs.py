# SPDX-License-Identifier: Apache-2.0
"""Dialogs to open and close recordings; messages, and the panel of work under way."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from nicegui import ui

from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.work.device_work import DeviceWork
from imu_workbench.web.work.fit_queue import QueuedFit
from imu_workbench.web.work.jobs import Stoppable, time_left
from imu_workbench.web.work.notices import Notices
from imu_workbench.web.work.workspace import Workspace


@contextmanager
def named_dialog(title: str, classes: str = '') -> Iterator[ui.dialog]:
    """Draw a dialog with a heading, by which screen readers know it."""
    box = f'card dialog {classes}'
    with ui.dialog().props(f'aria-label="{title}"') as dialog, ui.element('div').classes(box):
        ui.html(f'<h2>{title}</h2>', sanitize=False)
        yield dialog


class OpenDialog:
    """A list of the bags there are, and a path to type."""

    def __init__(self, root: BagRoot, opened: Callable[[list[str]], Awaitable[None]]) -> None:
        self._root, self._opened = root, opened
        self._ticked: dict[Path, ui.checkbox] = {}
        with named_dialog('Open bags') as self._dialog:
            ui.label(f'Below {root.folder}. One bag is one run; take all runs of a device.')
            self._list = ui.element('div').classes('bag-list')
            self._path = ui.input('or a path below it').props('dense outlined').classes('path')
            self._path.on('keydown.enter', self._open)
            self._path.on_value_change(self._offer)
            with ui.row().classes('actions'):
                self._button = ui.button('Open', on_click=self._open).props('no-caps unelevated')
                ui.button('Cancel', on_click=self._dialog.close).props('no-caps flat')

    async def show(self) -> None:
        """Show the bags there are now."""
        self._dialog.open()
        bags = await asyncio.to_thread(self._root.bags)
        self._list.clear()
        self._ticked = {}
        with self._list:
            for bag in bags:
                box = ui.checkbox(self._root.name_of(bag), on_change=self._offer).props('dense')
                self._ticked[bag] = box
            if not bags:
                ui.label('There are none.').classes('soft')
        self._offer()

    def _chosen(self) -> list[str]:
        chosen = [str(bag) for bag, box in self._ticked.items() if box.value]
        return [*chosen, *([self._path.value.strip()] if self._path.value.strip() else [])]

    def _offer(self) -> None:
        self._button.set_enabled(bool(self._chosen()))

    async def _open(self) -> None:
        chosen = self._chosen()
        if chosen:
            self._dialog.close()
            await self._opened(chosen)


class RecordingsDialog:
    """The recordings of the case, each with a button to close it."""

    def __init__(self, close: Callable[[str], Awaitable[None]]) -> None:
        self._close_bag = close
        with named_dialog('Recordings of the case') as self._dialog:
            self._list = ui.element('div').classes('bag-list')
            ui.label('A recording that is closed stays in the case; open its bag to use it again.')
            with ui.row().classes('actions'):
                ui.button('Done', on_click=self._dialog.close).props('no-caps unelevated')

    def show(self, work: DeviceWork) -> None:
        """Show the recordings of a device."""
        self._list.clear()
        with self._list:
            for recording in work.case.recordings:
                with ui.element('div').classes('recording'):
                    state = '' if recording.open else ' (closed)'
                    ui.label(f'{recording.run}{state}').classes('recording-run')
                    ui.label(recording.source).classes('soft recording-source')
                    if recording.open:
                        button = ui.button(
                            'Close', on_click=lambda _, run=recording.run: self._end(run)
                        )
                        button.props(f'no-caps outline dense aria-label="close {recording.run}"')
        self._dialog.open()

    async def _end(self, run: str) -> None:
        self._dialog.close()
        await self._close_bag(run)


class Messages:
    """Errors and remarks of the server, newest first; the same in every tab."""

    def __init__(self, notices: Notices) -> None:
        self._notices = notices
        self._shown: list[int] = []
        self._place = ui.element('div').classes('messages').props('role=alert aria-live=assertive')

    def refresh(self) -> None:
        """Show the messages there are now."""
        wanted = [message.number for message in self._notices.messages]
        if wanted == self._shown:
            return
        self._shown = wanted
        self._place.clear()
        with self._place:
            for message in self._notices.messages:
                with ui.element('div').classes(f'message {message.kind}'):
                    ui.label(message.text)
                    close = ui.element('button').classes('close')
                    close.props('type=button aria-label="close this message"')
                    close.on('click', lambda _, n=message.number: self._notices.close_message(n))
                    with close:
                        ui.label('×')


class WorkPanel:
    """Work under way and fits that wait, each with its progress and a button to cancel it."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._place = ui.element('div').classes('work').props('role=status aria-live=polite')
        self._shown: list[object] = []
        self._labels: list[tuple[ui.label, Stoppable | QueuedFit]] = []
        self._timer = ui.timer(0.5, self._tick, active=False)

    def refresh(self) -> None:
        """Show what is under way."""
        fits = self._workspace.versions.queue.fits
        own = {id(fit.job) for fit in fits if fit.job is not None}
        jobs = [job for job in self._workspace.notices.jobs if id(job) not in own]
        rows: list[Stoppable | QueuedFit] = [*fits, *jobs]
        if rows != self._shown:
            self._shown = list(rows)
            self._labels = []
            self._place.clear()
            with self._place:
                for row in rows:
                    self._row(row)
        self._timer.active = bool(rows)
        self._tick()

    def _row(self, row: Stoppable | QueuedFit) -> None:
        fit = row if isinstance(row, QueuedFit) else None
        with ui.element('div').classes('job fit' if fit else 'job'):
            label = ui.label('starting …')
            button = ui.button('Cancel', on_click=lambda: self._cancel(row))
            button.props('no-caps flat dense')
            if fit:
                button.props(f'aria-label="cancel {fit.told}"')
        self._labels.append((label, row))

    def _cancel(self, row: Stoppable | QueuedFit) -> None:
        if isinstance(row, QueuedFit):
            self._workspace.versions.queue.cancel(row)
        else:
            row.cancel()

    def _tick(self) -> None:
        now = time.monotonic()
        for label, row in self._labels:
            if isinstance(row, QueuedFit):
                left = time_left(row.job, now) if row.job is not None else ''
                state = f'{left or "starting"}' if row.state == 'running' else 'waits'
                label.set_text(f'{row.device}: {row.told}: {state}')
            else:
                told = f'{row.about and f"{row.about}: "}{row.progress or "starting"} …'
                label.set_text(f'{told} {time_left(row, now)}'.strip())
