# SPDX-License-Identifier: Apache-2.0
"""The page: bar, tabs, dialog, messages; it connects what the user does with what is drawn."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nicegui import ui
from thermal_comp.data.conditions import SENSORS

from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.case.add_page import AddActions, AddPage
from imu_workbench.web.case.channel_selector import ChannelSelector
from imu_workbench.web.case.compare_page import ComparePage
from imu_workbench.web.case.learn_page import LearnActions, LearnPage
from imu_workbench.web.case.stored_bag import StoredBag
from imu_workbench.web.case.tasks import Change
from imu_workbench.web.case.view import Place
from imu_workbench.web.jobs import Stoppable
from imu_workbench.web.plot import Look
from imu_workbench.web.result_cache import ResultCache
from imu_workbench.web.session import Display, WorkbenchTab

PHONE_WIDTH_PX = 640
"""Width [px] below which figures stand below each other."""
BROWSER_TIMEOUT_S = 60.0
"""How long a browser may take to answer before its page is given up [s]."""


@dataclass(frozen=True)
class Start:
    """What every tab opens with."""

    bags: tuple[Path, ...] = ()
    model_text: str | None = None
    effects: tuple[Path, ...] = ()
    """Files with effects of the user's own."""
    remap: Mapping[str, str] = field(default_factory=dict)
    """Names of the logging contract → names in the bags."""


class Page:
    """One browser tab: builds it and keeps it up to date."""

    def __init__(self, cache: ResultCache, start: Start) -> None:
        self._start = start
        self._look = Look()
        self._dark = ui.dark_mode(None)
        self._tab = WorkbenchTab(cache, Display(self._show_work, self._say), start.remap)
        self._build()

    @contextmanager
    def _show_work(self, job: Stoppable) -> Iterator[None]:
        self._work.start(job)
        try:
            yield
        finally:
            self._work.end(job)

    def _say(self, text: str) -> None:
        self._messages.say(text)

    def _build(self) -> None:
        session = self._tab.session
        self._dialog = OpenDialog(self._tab.cache.root, self.open_bags)
        with ui.element('header').classes('bar'):
            ui.html('<h1>IMU workbench</h1>', sanitize=False)
            self._device = ui.select(
                [], label='Device', on_change=lambda event: self._choose_device(event.value)
            )
            self._device.props('dense outlined options-dense').classes('device')
            ui.button('Open bags', on_click=self._dialog.show).props('no-caps outline')
            self._summary = ui.label('').classes('soft summary')
            theme = ui.button('Light / dark', on_click=self._switch_theme)
            theme.props('no-caps flat aria-label="switch between light and dark"')
        with (
            ui.tabs(on_change=self.refresh)
            .classes('tabs')
            .props('no-caps align=left dense') as self._tabs
        ):
            for name in ('Compare', 'Learn', 'Add', 'Live'):
                ui.tab(name)
        self._messages = Messages()
        self._work = Work()
        with ui.element('div').classes('body'):
            self._tiles = ChannelSelector(session, self._choose_channel)
            with ui.tab_panels(self._tabs, value='Compare', animated=False).classes('panels'):
                with ui.tab_panel('Compare'):
                    self._compare = ComparePage(session, self._look, self.go_to)
                with ui.tab_panel('Learn'):
                    actions = LearnActions(
                        self._diagnose, self._add, self._tab.preview, self._tab.next_profile
                    )
                    self._learn = LearnPage(session, self._look, actions)
                with ui.tab_panel('Add'):
                    self._add_page = AddPage(session, self._look, self._add_actions())
                with ui.tab_panel('Live') as self._live:
                    self._live_page: Any = None
        ui.on('narrow', lambda event: self._on_narrow(narrow=bool(event.args)))
        ui.on('dark', lambda event: self._on_system_theme(dark=bool(event.args)))
        ui.context.client.on_delete(self._work.cancel_all)
        ui.timer(0.0, self._start_up, once=True)

    def _add_actions(self) -> AddActions:
        return AddActions(
            add=self._add,
            remove=self._remove,
            undo=self._undo,
            show_version=self._show_version,
            compare_with=self._compare_with,
            save_model=self._save_model,
            save_report=self._save_report,
            load_model=self._load_model,
            load_effects=self._load_effects,
        )

    async def _start_up(self) -> None:
        await ui.context.client.connected()
        look = await ui.run_javascript(f'watchLook({PHONE_WIDTH_PX})', timeout=BROWSER_TIMEOUT_S)
        self._look.dark, self._look.narrow, self._look.touch = map(bool, look)
        self._colours()
        for file in self._start.effects:
            await self._tab.load_effects(file.name, file.read_bytes())
        if self._start.bags:
            await self.open_bags([str(bag) for bag in self._start.bags])
        else:
            await self.refresh()
            await self._dialog.show()

    async def open_bags(self, paths: list[str]) -> None:
        """Open bags and compare the first device's with its model."""
        if await self._tab.open_bags(paths, self._show_read):
            await self._show_device()

    async def _show_read(self) -> None:
        session = self._tab.session
        self._device.set_options(list(session.devices), value=session.device)
        await self.refresh()

    async def _choose_device(self, name: str) -> None:
        if name and name != self._tab.session.device:
            self._tab.session.device = name
            await self._show_device()

    async def _show_device(self) -> None:
        session, state = self._tab.session, self._tab.session.state
        session.look_at(place=None)
        if state is not None and not state.versions:
            await self.refresh()
            await self._tab.first_version(self._start.model_text)
        elif session.view.sensor not in session.sensors():
            session.look_at_worst()
        await self.refresh()

    async def _choose_channel(self, sensor: str, axis: int) -> None:
        session = self._tab.session
        if session.version is None or sensor in session.sensors():
            session.look_at(sensor=sensor, axis=axis)
            await self.refresh()

    async def go_to(self, place: Place | None) -> None:
        """Let every plot show a place."""
        self._tab.session.go_to(place)
        await self.refresh()

    async def refresh(self) -> None:
        """Draw what is on the screen."""
        state = self._tab.session.state
        self._tiles.refresh()
        self._summary.set_text(runs_summary(state.bags) if state else '')
        shown = self._tabs.value
        self._tiles.show(visible=shown != 'Live' and state is not None)
        if self._live_page is not None:
            self._live_page.active = shown == 'Live'
        if shown == 'Live':
            self._show_live()
        elif shown == 'Learn':
            await self._learn.refresh()
        elif shown == 'Add':
            await self._add_page.refresh()
        else:
            await self._compare.refresh()

    def _show_live(self) -> None:
        if self._live_page is not None:
            return
        with self._live:
            from imu_workbench.web.live.page import build_live

            self._live_page = build_live(self._live, dark=lambda: self._look.dark)

    def _repaint(self) -> None:
        for page in (self._compare, self._learn, self._add_page):
            page.repaint()

    def _colours(self) -> None:
        ui.colors(primary='#2a7fb4' if self._look.dark else '#0072b2')

    def _on_narrow(self, *, narrow: bool) -> None:
        """Lay the figures out anew: the window has become narrow or wide, the phone was turned."""
        self._look.narrow = narrow
        self._repaint()

    def _on_system_theme(self, *, dark: bool) -> None:
        if self._dark.value is None:  # nobody has chosen here
            self._look.dark = dark
            self._colours()
            self._repaint()

    async def _switch_theme(self) -> None:
        self._look.dark = not self._look.dark
        self._dark.set_value(self._look.dark)
        self._colours()
        self._repaint()

    async def _diagnose(self) -> None:
        if await self._tab.diagnose():
            await self.refresh()

    async def _add(self, effect: str, sensors: list[str]) -> None:
        await self._tab.change(change_of(effect, sensors))
        await self.refresh()

    async def _remove(self, effect: str, sensors: list[str]) -> None:
        await self._tab.change(change_of(effect, sensors, added=False))
        await self.refresh()

    async def _undo(self) -> None:
        if self._tab.session.state:
            self._tab.session.state.undo()
            await self.refresh()

    async def _show_version(self, number: int) -> None:
        state = self._tab.session.state
        if state and number != state.current:
            state.current = number
            await self.refresh()

    async def _compare_with(self, number: int | None) -> None:
        if self._tab.session.state:
            self._tab.session.state.earlier = number
            await self.refresh()

    def _save_model(self) -> None:
        session = self._tab.session
        if session.version:
            ui.download.content(session.version.model_text, f'{session.device}.yaml')

    async def _save_report(self) -> None:
        path = await self._tab.report()
        if path is not None:
            ui.download.file(path, f'{self._tab.session.device}.html')

    async def _load_model(self, name: str, content: bytes) -> None:
        try:
            text = content.decode('utf-8')
        except UnicodeDecodeError:
            self._messages.say(f'{name}: not a text file; a model file is YAML')
            return
        await self._tab.first_version(text)
        await self.refresh()

    async def _load_effects(self, name: str, content: bytes) -> None:
        if await self._tab.load_effects(name, content):
            self._messages.say(
                f'{Path(name).name}: its effects are in the list of effects now', 'info'
            )
            state = self._tab.session.state
            if state is not None and not state.versions:
                await self._tab.first_version(self._start.model_text)
        await self.refresh()


def change_of(effect: str, sensors: Sequence[str], *, added: bool = True) -> Change:
    """Return the change of an effect in some sensors, by their names."""
    return Change(effect, tuple(s for s in SENSORS if s in sensors), added)


def runs_summary(bags: Sequence[StoredBag]) -> str:
    """Return the number of runs and of samples in words."""
    samples = f'{sum(bag.samples for bag in bags):,}'.replace(',', '\N{NARROW NO-BREAK SPACE}')
    return f'{len(bags)} {"run" if len(bags) == 1 else "runs"} · {samples} samples'


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


MAX_MESSAGES = 4
"""Messages that stay."""


class Messages:
    """Errors and remarks, newest first."""

    def __init__(self) -> None:
        self._place = ui.element('div').classes('messages').props('role=alert aria-live=assertive')

    def say(self, text: str, kind: str = 'error') -> None:
        """Show a message; the same text once."""
        for child in list(self._place):
            if getattr(child, 'message_text', None) == text:
                return
        with self._place:
            row = ui.element('div').classes(f'message {kind}')
            row.message_text = text  # type: ignore[attr-defined]
            with row:
                ui.label(text)
                close = (
                    ui.element('button')
                    .classes('close')
                    .props('type=button aria-label="close this message"')
                )
                close.on('click', row.delete)
                with close:
                    ui.label('×')
        row.move(target_index=0)
        for child in list(self._place)[MAX_MESSAGES:]:
            child.delete()

    def clear(self) -> None:
        """Close all messages."""
        self._place.clear()


class Work:
    """The jobs of a tab, each with its progress and a button to cancel it."""

    def __init__(self) -> None:
        self.jobs: list[Stoppable] = []
        self._place = ui.element('div').classes('work').props('role=status aria-live=polite')
        self._labels: dict[Stoppable, ui.label] = {}
        self._timer = ui.timer(0.25, self._show_progress, active=False)

    def start(self, job: Stoppable) -> None:
        """Show a job."""
        self.jobs.append(job)
        with self._place:
            row = ui.element('div').classes('job')
            with row:
                ui.spinner(size='1.1em')
                self._labels[job] = ui.label('starting …')
                ui.button('Cancel', on_click=job.cancel).props('no-caps flat dense')
        self._timer.activate()

    def end(self, job: Stoppable) -> None:
        """Take a job off the page."""
        if job in self.jobs:
            self.jobs.remove(job)
            self._labels.pop(job).parent_slot.parent.delete()  # type: ignore[union-attr]
        if not self.jobs:
            self._timer.deactivate()

    def cancel_all(self) -> None:
        """End every job."""
        for job in self.jobs:
            job.cancel()

    def _show_progress(self) -> None:
        for job, label in self._labels.items():
            label.set_text(f'{job.progress} …' if job.progress else 'starting …')
