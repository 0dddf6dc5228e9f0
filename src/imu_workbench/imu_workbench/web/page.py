# SPDX-License-Identifier: Apache-2.0
"""The page of one browser tab: it connects what the user does with the case and what is drawn."""

from __future__ import annotations

import asyncio
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from imu_recording.user_error import UserError
from nicegui import ui
from thermal_comp.data.conditions import SENSORS

from imu_workbench.case_effects import kept_effects
from imu_workbench.web.case.centre import Centre
from imu_workbench.web.case.channel_selector import ChannelSelector
from imu_workbench.web.case.explained import ExperimentDialog, ExplainDialog
from imu_workbench.web.case.preview import EffectPreview
from imu_workbench.web.case.rail import Rail, RailActions
from imu_workbench.web.case.stored_bag import StoredBag
from imu_workbench.web.case.tasks import Change
from imu_workbench.web.case.top_strip import TopActions, TopStrip
from imu_workbench.web.case.versions_panel import VersionActions, VersionsPanel
from imu_workbench.web.case.view import Place
from imu_workbench.web.dialogs import Messages, OpenDialog, RecordingsDialog, WorkPanel
from imu_workbench.web.fleet import FleetView
from imu_workbench.web.plot import Look
from imu_workbench.web.redraw import Redraw
from imu_workbench.web.session import PAGE_VIEWS, Session, Shown
from imu_workbench.web.work.workspace import Workspace

PHONE_WIDTH_PX = 640
"""Width [px] below which figures stand below each other."""
BROWSER_TIMEOUT_S = 60.0
"""How long a browser may take to answer before its page is given up [s]."""


class Page:
    """One browser tab: builds it and keeps it up to date."""

    def __init__(self, workspace: Workspace, query: Mapping[str, str], *, local: bool) -> None:
        """`local`: only this machine can open the page, so that it may load effect files."""
        self._workspace, self._local = workspace, local
        self._session = Session(workspace, query)
        self._look = Look()
        self._theme_chosen = False
        self._client = ui.context.client
        self._changed = Redraw(self._client, self._refresh)
        self._figures = Redraw(self._client, self._draw_figures)
        """Figures take seconds for long recordings: all else is drawn meanwhile."""
        self._tab = ''
        self._preview: EffectPreview | None = None
        self._previewed: tuple[Any, ...] | None = None
        self._live_page: Any = None
        self._followed: set[int] = set()
        self._asked: set[tuple[str, str]] = set()
        self._shown_address = ''
        self._build()

    # Layout ------------------------------------------------------------------------------------

    def _build(self) -> None:
        session, look = self._session, self._look
        self._open_dialog = OpenDialog(self._workspace.cache.root, self._open_bags)
        self._recordings = RecordingsDialog(self._close_bag)
        self._explain_dialog = ExplainDialog()
        self._experiment = ExperimentDialog(look)
        with ui.element('header').classes('bar'):
            self._bar()
        self._messages = Messages(self._workspace.notices)
        self._work = WorkPanel(self._workspace)
        with ui.element('main').classes('body case') as self._case:
            top = TopActions(self._preview_in, self._add, self._plan, self._save_report)
            self._top = TopStrip(session, top)
            self._tiles = ChannelSelector(session, self._choose_channel)
            with ui.element('div').classes('middle'):
                self._centre = Centre(session, look, self._go_to, self._brush)
                rail = RailActions(
                    preview=self._toggle_preview,
                    add=self._add,
                    take_out=self._take_out,
                    explain=lambda effect: self._explain_dialog.show(
                        self._workspace.effects.explained[effect]
                    ),
                    load_effects=self._load_effects,
                    load_kept=self._load_kept,
                )
                self._rail = Rail(session, rail, may_load=self._local)
            actions = VersionActions(
                show=self._show_version,
                save_model=self._save_model,
                save_report=self._save_report,
                save_case=self._save_case,
                open_model=self._open_model,
                keep_statement=self._keep_statement,
                note=lambda text: self._workspace.note(session.device, text),
            )
            self._versions = VersionsPanel(session, look, actions)
        with ui.element('main').classes('body') as self._fleet_place:
            self._fleet = FleetView(self._workspace.fleet, self._open_case)
        self._live = ui.element('main').classes('body live-body-place')
        ui.on('narrow', lambda event: self._on_narrow(narrow=bool(event.args)))
        ui.on('dark', lambda event: self._on_system_theme(dark=bool(event.args)))
        ui.on('went', lambda event: self._went(str(event.args)))
        self._client.on_delete(self._leave)
        self._client.content.props('inert')  # a press would be lost before handlers are known
        self._show_parts()  # the browser is still loading plotly.js
        self._address(step=False)
        ui.timer(0.0, self._start_up, once=True)

    def _bar(self) -> None:
        ui.html('<h1>IMU workbench</h1>', sanitize=False)
        self._device = ui.select(
            [], label='Device', on_change=lambda event: self._choose_device(event.value)
        )
        self._device.props('dense outlined options-dense').classes('device')
        ui.button('Open bags', on_click=self._open_dialog.show).props('no-caps outline')
        self._recordings_button = ui.button('', on_click=self._show_recordings)
        self._recordings_button.props('no-caps flat').classes('summary')
        with ui.element('nav').classes('views').props('aria-label="Views"'):
            self._views = {
                shown: ui.button(
                    shown.capitalize(), on_click=lambda _, shown=shown: self._switch(shown)
                )
                for shown in PAGE_VIEWS
            }
            for button in self._views.values():
                button.props('no-caps flat')
        theme = ui.button('Light / dark', on_click=self._switch_theme)
        theme.props('no-caps flat aria-label="Light / dark: switch"')

    async def _load_effects(self, name: str, content: bytes) -> None:
        if self._local:
            self._tell_of_effects(name, await self._workspace.effects.load(name, content))

    async def _load_kept(self, key: str) -> None:
        work = self._session.work
        if work is not None and self._local:
            name = kept_effects(work.case)[key]
            self._tell_of_effects(name, await self._workspace.effects.load_kept(work.case, key))

    def _tell_of_effects(self, name: str, new: Sequence[str]) -> None:
        if new:
            names = ', '.join(effect.replace('_', ' ') for effect in new)
            self._workspace.notices.say(f'{Path(name).name}: {names} can be added now', 'info')

    async def _start_up(self) -> None:
        await self._client.connected()
        look = await ui.run_javascript(f'watchLook({PHONE_WIDTH_PX})', timeout=BROWSER_TIMEOUT_S)
        self._look.dark, self._look.narrow, self._look.touch = map(bool, look[:3])
        self._tab, self._theme_chosen = str(look[3]), bool(look[4])
        self._colours()
        self._client.content.props(remove='inert')
        self._workspace.notices.listen(self._changed)
        self._changed()
        nothing = not self._workspace.opening and not self._workspace.devices
        if nothing and self._session.shown == 'case':
            await self._open_dialog.show()

    def _leave(self) -> None:
        self._workspace.notices.leave(self._changed)
        self._workspace.answers.order.leave(self)

    # Drawing -----------------------------------------------------------------------------------

    async def _refresh(self) -> None:
        session = self._session
        self._follow_fits()
        session.settle()
        self._workspace.answers.order.look(self, session.device)
        self._address(step=False)
        if self._live_page is not None:
            self._live_page.active = session.shown == 'live'
        if session.shown == 'live':
            self._show_live()
        elif session.shown == 'fleet':
            self._fleet.refresh()
        else:
            self._load_what_is_missing()
        preview = self._fresh_preview() if session.shown == 'case' else None
        self._show_parts(preview)
        if session.shown == 'case':
            self._versions.draw()
            self._figures()

    async def _draw_figures(self) -> None:
        await self._centre.refresh(self._fresh_preview())

    def _show_parts(self, preview: EffectPreview | None = None) -> None:
        """Show all but the figures of the case."""
        session = self._session
        session.settle()
        work = session.work
        devices = list(self._workspace.devices)
        if (devices, session.device) != (self._device.options, self._device.value or ''):
            self._device.set_options(devices, value=session.device or None)
        self._device.set_enabled(len(devices) > 0)
        self._recordings_button.set_text(runs_summary(work.bags) if work else '')
        self._recordings_button.set_visibility(work is not None)
        self._messages.refresh()
        self._work.refresh()
        places = {'case': self._case, 'fleet': self._fleet_place, 'live': self._live}
        for shown, button in self._views.items():
            current = 'page' if shown == session.shown else 'false'
            button.props(f'aria-current={current}')
            places[shown].visible = shown == session.shown
        if session.shown == 'case':
            self._top.refresh()
            self._tiles.refresh()
            self._rail.refresh(preview)
            self._versions.refresh()
            self._centre.show_place()

    def _follow_fits(self) -> None:
        """Show the version made by a fit that this tab asked for."""
        session = self._session
        for fit in self._workspace.versions.queue.finished:
            same = (fit.device, fit.start) == (session.device, session.version_name)
            if fit.number not in self._followed and fit.tab == self._tab and same:
                session.choose_version(fit.result)
            self._followed.add(fit.number)

    def _load_what_is_missing(self) -> None:
        """Have the version looked at, and the one before it, compared with the recordings."""
        session, work = self._session, self._session.work
        if work is None or self._workspace.opening or not work.bags:
            return
        for name in (session.version_name, session.earlier_name):
            known = work.case.version(name) is not None and name not in work.failed
            if known and name not in work.loaded and (session.device, name) not in self._asked:
                self._asked.add((session.device, name))
                self._workspace.runner.begin(self._load(session.device, name))

    async def _load(self, device: str, name: str) -> None:
        try:
            await self._workspace.versions.load(device, name)
        finally:
            self._asked.discard((device, name))

    def _fresh_preview(self) -> EffectPreview | None:
        """Return the preview that belongs to what is looked at; ask for it where it is missing."""
        session = self._session
        wanted = (session.device, session.version_name, session.candidate, session.view.sensor)
        if not session.candidate or session.version is None:
            return None
        ready = session.work is not None and (
            session.version_name in session.work.found
            or not self._workspace.answers.is_diagnosing(session.device, session.version_name)
        )
        if wanted != self._previewed and ready:
            self._previewed, self._preview = wanted, None
            self._workspace.runner.begin(self._fetch_preview(wanted))
        return self._preview if wanted == self._previewed else None

    async def _fetch_preview(self, wanted: tuple[Any, ...]) -> None:
        preview = await self._workspace.answers.preview(*wanted)
        if wanted == self._previewed:
            self._preview = preview
            self._changed()

    def _show_live(self) -> None:
        if self._live_page is None:
            with self._live:
                from imu_workbench.web.live.page import build_live

                self._live_page = build_live(self._live, dark=lambda: self._look.dark)

    def _address(self, *, step: bool) -> None:
        """Write what is shown into the address; `step`: as a new entry of its history."""
        query = json.dumps(self._session.query())
        if (query, step) != (self._shown_address, False):
            self._shown_address = query
            ui.run_javascript(f'showAddress({query}, {"true" if step else "false"})')

    def _step(self) -> None:
        """Draw what the user has chosen, and make it an entry of the browser's history."""
        self._session.settle()
        self._address(step=True)
        self._changed()

    def _repaint(self) -> None:
        for part in (self._centre, self._versions):
            part.repaint()

    def _colours(self) -> None:
        ui.colors(primary='#1d6c9c' if self._look.dark else '#0072b2')

    def _on_narrow(self, *, narrow: bool) -> None:
        """Lay the figures out anew: the window has become narrow or wide, the phone was turned."""
        self._look.narrow = narrow
        self._repaint()

    def _on_system_theme(self, *, dark: bool) -> None:
        if not self._theme_chosen:
            self._look.dark = dark
            self._colours()
            self._repaint()

    def _switch_theme(self) -> None:
        self._look.dark = not self._look.dark
        self._theme_chosen = True
        ui.run_javascript(f'chooseTheme({json.dumps(self._look.dark)})')
        self._colours()
        self._repaint()

    # What the user looks at --------------------------------------------------------------------

    def _went(self, query: str) -> None:
        """The browser went back or forth."""
        self._session.follow(dict(parse_qsl(query.removeprefix('?'))))
        self._workspace.versions.queue.forget(self._tab)
        self._shown_address = json.dumps(query)
        self._changed()

    def _switch(self, shown: Shown) -> None:
        self._session.shown = shown
        self._step()

    async def _open_case(self, device: str) -> None:
        """Go from the fleet into a device's case."""
        self._session.shown = 'case'
        opening = self._workspace.open_case(device)
        self._choose_device(device)
        self._step()
        await opening

    def _choose_device(self, name: str | None) -> None:
        if name and name != self._session.device:
            self._session.choose_device(name)
            self._step()

    def _choose_channel(self, sensor: str, axis: int) -> None:
        if self._session.version is None or sensor in self._session.sensors():
            self._session.choose_channel(sensor, axis)
            self._step()

    def _show_version(self, name: str) -> None:
        session = self._session
        if name != session.version_name:
            session.choose_version(name)
            self._workspace.show(session.device, name)
            self._workspace.versions.queue.forget(self._tab)
            self._step()

    async def _go_to(self, place: Place | None) -> None:
        self._session.go_to(place)
        self._step()

    async def _brush(self, window: tuple[float, float] | None) -> None:
        self._session.brush(window)
        self._step()

    def _toggle_preview(self, effect: str) -> None:
        session = self._session
        session.candidate = '' if session.candidate == effect else effect
        self._step()

    def _preview_in(self, effect: str, sensors: tuple[str, ...]) -> None:
        session = self._session
        if sensors and session.view.sensor not in sensors:
            session.choose_channel(sensors[0], session.view.axis)
        session.candidate = effect
        self._step()

    # What the user does ------------------------------------------------------------------------

    async def _open_bags(self, paths: list[str]) -> None:
        opened = await self._workspace.open_bags(paths)
        if opened and self._session.device not in opened:
            self._session.choose_device(opened[0])
            self._step()

    async def _close_bag(self, run: str) -> None:
        await self._workspace.close_bag(self._session.device, run)

    def _show_recordings(self) -> None:
        if self._session.work is not None:
            self._recordings.show(self._session.work)

    def _add(self, effect: str, sensors: tuple[str, ...]) -> None:
        self._request(change_of(effect, sensors, added=True))

    def _take_out(self, effect: str, sensors: tuple[str, ...]) -> None:
        self._request(change_of(effect, sensors, added=False))

    def _request(self, change: Change) -> None:
        session = self._session
        queue = self._workspace.versions.queue
        queue.request(session.device, session.version_name, change, self._tab)

    async def _plan(self, one: str, other: str) -> None:
        session = self._session
        found = await self._workspace.answers.next_profile(
            session.device, session.version_name, one, other
        )
        if found is not None:
            self._experiment.show(found)

    def _save_model(self) -> None:
        session = self._session
        work = session.work
        if work is not None and work.case.version(session.version_name):
            try:
                text = work.case.model_text(session.version_name)
            except UserError as error:
                self._workspace.notices.say(str(error))
                return
            ui.download.content(text, f'{session.device}_{session.version_name}.yaml')

    async def _save_report(self) -> None:
        session = self._session
        if session.version is not None:
            name = f'{session.device}_{session.version_name}_certificate.html'
            path = await self._workspace.answers.report(session.device, session.version_name)
            if path is not None:
                with self._client:
                    ui.download.file(path, name)

    async def _save_case(self) -> None:
        work = self._session.work
        if work is not None:
            target = self._workspace.cache.fresh_path()
            path = await asyncio.to_thread(zipped, work.case.folder, target)
            with self._client:
                ui.download.file(path, f'{work.name}_case.zip')

    async def _keep_statement(self, name: str, content: bytes) -> None:
        if self._session.work is not None:
            self._workspace.keep_statement(self._session.device, name, content)

    async def _open_model(self, name: str, content: bytes) -> None:
        try:
            text = content.decode('utf-8')
        except UnicodeDecodeError:
            self._workspace.notices.say(f'{name}: not a text file; a model file is YAML')
            return
        version = await self._workspace.versions.open_model(self._session.device, text)
        if version:
            self._show_version(version)


def zipped(folder: Path, target: Path) -> Path:
    """Return a zip of a folder; files of this process's own are left out."""
    copy = target / folder.name
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns('.*'))
    return Path(shutil.make_archive(str(target / 'case'), 'zip', target, folder.name))


def change_of(effect: str, sensors: tuple[str, ...], *, added: bool) -> Change:
    """Return the change of an effect in some sensors, by their names."""
    return Change(effect, tuple(s for s in SENSORS if s in sensors), added)


def runs_summary(bags: Sequence[StoredBag]) -> str:
    """Return the number of runs and of samples in words."""
    samples = f'{sum(bag.samples for bag in bags):,}'.replace(',', '\N{NARROW NO-BREAK SPACE}')
    return f'{len(bags)} {"run" if len(bags) == 1 else "runs"} · {samples} samples'
