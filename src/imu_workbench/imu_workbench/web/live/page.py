# SPDX-License-Identifier: Apache-2.0
"""The live view on a page: chooses a device, shows it a few times a second."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

from imu_recording.recording import SECOND_NS
from nicegui import run, ui
from thermal_comp.presentation.display import FILTER_LABELS, SENSORS

from imu_workbench.report.figures.palette import painted
from imu_workbench.web.live.attitude_drawing import board_svg
from imu_workbench.web.live.figures import (
    FILTER_LOOK,
    euler_figure,
    measured_figure,
    residual_figure,
    temperature_figure,
)
from imu_workbench.web.live.readings import FULL_RATE_S, attitude, newest, zero_second
from imu_workbench.web.live.state import FILTERS
from imu_workbench.web.live.tables import (
    attitude_table,
    details,
    environment_values,
    headline,
    silent_roles,
    topics_table,
    values_table,
    verdict,
)
from imu_workbench.web.live.topics import (
    ROLES,
    choices,
    concerns,
    namespaces,
    shared_topics,
)
from imu_workbench.web.plot import PlotElement

LIVE_CSS = """
.live-grid { display: grid; gap: 12px; width: 100%;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 380px), 1fr)); }
.live-body { width: 100%; display: grid; gap: 12px; }
.live-tall { height: 330px; }
.live-table caption { display: none; }
.live-topics td:last-child { text-align: left; white-space: normal; overflow-wrap: anywhere; }
.live-topics th:last-child { text-align: left; }
.live-wide { grid-column: span 2; }
@media (max-width: 840px) { .live-wide { grid-column: auto; } }
.live-boards { display: grid; grid-template-columns: 1fr 1fr; width: 100%; }
.live-boards svg { width: 100%; height: auto; max-height: 250px; }
.live-scroll { overflow-x: auto; max-width: 100%; width: 100%; }
.live-controls .q-field { min-width: 7.5rem; }
.live-controls .live-device { min-width: 9rem; }
.live-tiles dl { display: flex; flex-wrap: wrap; gap: 6px 22px; margin: 0; }
.live-tiles dt { font-size: 12px; opacity: 0.75; }
.live-tiles dd { margin: 0; font-size: 17px; font-variant-numeric: tabular-nums; }
.live-message { font-weight: 500; overflow-wrap: anywhere; }
.live-grid > *, .live-body > * { min-width: 0; }
.live .q-expansion-item, .live .q-item__label, .live .q-expansion-item__content {
  min-width: 0; max-width: 100%; overflow-wrap: anywhere; }
.live-table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }
.live-table th, .live-table td { padding: 2px 8px; text-align: right; white-space: nowrap; }
.live-table th[scope=row], .live-table th:first-child { text-align: left; font-weight: 500; }
.live-table tbody tr { border-top: 1px solid rgba(128, 140, 155, 0.3); }
.live-warning .q-item__label { border-left: 4px solid #e69f00; padding-left: 6px; }
.live-error .q-item__label { border-left: 4px solid #d55e00; padding-left: 6px; }
.live-stale .q-item__label { border-left: 4px solid #8b95a3; padding-left: 6px; }
.live-ok .q-item__label { border-left: 4px solid #009e73; padding-left: 6px; }
"""


UPDATE_PERIOD_S = 0.05
"""Period of the updates where the browser keeps up [s]."""
PAUSE_RATIO = 0.15
"""Pause after the browser has drawn, in units of the time that took."""
AWAIT_DRAWN = 'return new Promise(done => requestAnimationFrame(() => setTimeout(done)))'
DRAW_TIMEOUT_S = 5.0
"""How long the browser may take to draw [s]."""
WINDOWS_S = {20.0: '20 s', 120.0: '2 min', 900.0: '15 min', 3600.0: '1 h', 43_200.0: '12 h'}
NO_ROS = (
    'ROS 2 was not found. Source your ROS installation (or install requirements-ros.txt) in the '
    'shell that starts `serve`, then start it again; everything else on this page works without.'
)
NO_IMU_HEARD = 'No IMU is heard in ROS_DOMAIN_ID {domain}: start a driver, or play a bag.'


def build_live(container: Any, dark: Callable[[], bool] = lambda: False) -> LivePage:
    """Fill `container` with the live view; `dark` tells which theme the page has."""
    with container:
        ui.add_css(LIVE_CSS)
        return LivePage(dark)


class LivePage:
    """One browser tab's view of one device; `active` may be cleared while nobody looks."""

    def __init__(self, dark: Callable[[], bool]) -> None:
        self.active = True
        self._dark = dark
        self._listener: Any = None
        self._watch: Any = None
        self._shared: dict[str, str] = {}
        """Role → why its topic cannot be told apart."""
        self._zero = 0
        self._drawn: tuple[Any, ...] = ()
        self._plotted: dict[str, Any] = {}
        self._seen: dict[str, Any] = {}
        with ui.column().classes('w-full gap-3 live'):
            self._message = ui.label('Starting to listen …').classes('live-message')
            self._message.props('role=status aria-live=polite')
            self._controls()
            with ui.element('div').classes('live-body') as self._body:
                self._build()
            self._body.visible = False
            for control in (self._sensor, self._window, self._hold, self._zero_button):
                control.bind_enabled_from(self._body, 'visible')  # nothing else to act on
        ui.timer(0.05, self._start, once=True)
        self._timer = ui.timer(UPDATE_PERIOD_S, self._tick, active=False)

    async def _start(self) -> None:
        """Start to listen; the libraries of ROS take seconds to load."""
        try:
            self._listener = await run.io_bound(_listener)
        except ImportError:
            self._message.text, self._bar.visible = NO_ROS, False
            return
        except RuntimeError as error:
            self._message.text, self._bar.visible = f'ROS 2 does not start: {error}', False
            return
        self._timer.active = True

    def _controls(self) -> None:
        with ui.row().classes('items-center gap-3 live-controls') as self._bar:
            self._device = ui.select({}, label='live device', on_change=self._on_device)
            self._device.props('dense outlined').classes('live-device')
            self._sensor = ui.select(list(SENSORS), value=SENSORS[0], label='sensor')
            self._sensor.props('dense outlined')
            self._window = ui.select(WINDOWS_S, value=120.0, label='last')
            self._window.props('dense outlined')
            self._hold = ui.switch('hold')
            self._hold.tooltip('Stop the display; listening goes on')
            self._zero_button = ui.button('Take zero', on_click=self._take_zero)
            self._zero_button.props('outline no-caps')
            self._zero_button.tooltip('Count the static residual from now on')

    def _build(self) -> None:
        self._verdict = ui.label('').classes('live-message live-verdict')
        self._verdict.props('role=status')
        self._tiles = ui.html('', sanitize=False).classes('live-tiles')
        with ui.element('div').classes('live-grid'):
            self._measured = _plot('Measured: raw (grey) and compensated', 'live-tall')
            self._residual = _plot('Residual', 'live-tall')
            with _card('Attitude'):
                self._boards = ui.html('', sanitize=False).classes('live-boards')
                self._attitude = ui.html('', sanitize=False).classes('live-scroll')
            self._temperature = _plot('Temperature', 'live-tall')
            with _card('Values').classes('live-wide'):
                self._values = ui.html('', sanitize=False).classes('live-scroll')
            self._euler = _plot('Euler angles', 'live-tall')
            with _card('Diagnostics'):
                self._nodes = ui.column().classes('w-full gap-0')
            with _card('Topics'):
                self._topics = ui.html('', sanitize=False).classes('live-scroll')
                with ui.expansion('Other topics').classes('w-full'):
                    self._picks = {
                        name: ui.select([''], value='', label=name.replace('_', ' '))
                        .props('dense')
                        .classes('w-full')
                        .on_value_change(self._on_device)
                        for name in ROLES
                    }

    # Actions of the user ----------------------------------------------------------------------

    def _on_device(self) -> None:
        if self._listener is not None and self._device.value is not None:
            chosen = {name: pick.value for name, pick in self._picks.items() if pick.value}
            self._watch = self._listener.watch(self._device.value, chosen)
            self._zero, self._drawn, self._plotted = 0, (), {}

    def _take_zero(self) -> None:
        if self._watch is not None:
            with self._watch.state.lock:
                self._zero = zero_second(self._watch.state)
            self._drawn = ()

    # Updates ----------------------------------------------------------------------------------

    async def _tick(self) -> None:
        """Bring the page up to date, wait until the browser has drawn it, then pause.

        A slow or hidden browser is so sent no more than it can show.
        """
        if not self.active:
            return
        began = time.monotonic()
        if not self._update():
            return
        try:
            await ui.run_javascript(AWAIT_DRAWN, timeout=DRAW_TIMEOUT_S)
        except TimeoutError:  # the tab is in the background or gone
            self._drawn, self._plotted = (), {}
        await asyncio.sleep(PAUSE_RATIO * (time.monotonic() - began))

    def _update(self) -> bool:
        """Return whether there was anything new to draw."""
        found = namespaces(self._listener.topics)
        self._offer(found)
        if self._watch is None:
            self._message.text = NO_IMU_HEARD.format(domain=os.environ.get('ROS_DOMAIN_ID', '0'))
            return False
        state = self._watch.state
        with state.lock:
            now = newest(state)
            silent = silent_roles(state, self._watch.topics)
        self._body.visible = now >= 0
        self._shared = shared_topics(self._listener.topics, self._watch.topics)
        self._message.text = self._told(now, silent)
        self._message.visible = bool(self._message.text)
        self._show_nodes(found)
        shown = (now, self._sensor.value, self._window.value, self._zero, self._dark())
        due = now >= 0 and shown != self._drawn and not self._hold.value
        if due:
            self._drawn = shown
            self._draw()
        return due

    def _told(self, now: int, silent: list[str]) -> str:
        if now < 0:
            return 'Waiting for the first samples …'
        if self._shared:
            told = '; '.join(dict.fromkeys(self._shared.values()))
            return f'Warning: {told}: what is shown mixes them'
        if silent:
            return f'Silent: {", ".join(silent)}'
        restarts = self._watch.state.restarts
        return (
            f'The time stamps jumped back {restarts}×: the history was cleared.'
            if restarts
            else ''
        )

    def _offer(self, found: list[str]) -> None:
        """Bring the choices up to date; take the first device that is heard."""
        offered = {name: name or '/' for name in found}
        if self._device.value is not None:
            offered.setdefault(self._device.value, self._device.value or '/')
        if offered != self._device.options:
            self._device.set_options(offered, value=self._device.value)
            for role, pick in self._picks.items():
                pick.set_options(['', *choices(self._listener.topics, role)], value=pick.value)
        if self._device.value is None and found:
            self._device.value = found[0]

    def _draw(self) -> None:
        state, sensor, window = self._watch.state, self._sensor.value, self._window.value
        figures = []
        with state.lock:
            self._tiles.content = _tiles(environment_values(state))
            self._values.content = values_table(state, self._zero)
            self._attitude.content = attitude_table(state, self._shared)
            self._topics.content = topics_table(state, self._watch.topics)
            if self._is_new('samples', 1 if window <= FULL_RATE_S else SECOND_NS):
                figures = [
                    (self._measured, measured_figure(state, sensor, window)),
                    (self._residual, residual_figure(state, sensor, window, self._zero)),
                    (self._euler, euler_figure(state, window)),
                ]
            if self._is_new('seconds', SECOND_NS):
                figures.append((self._temperature, temperature_figure(state, window)))
                self._verdict.text = verdict(state, self._zero, self._shared)
            boards = [(name, attitude(state, name)) for name in FILTERS]
        theme = 'dark' if self._dark() else 'light'
        self._boards.content = ''.join(
            board_svg(FILTER_LABELS[name], now, FILTER_LOOK[name], theme) for name, now in boards
        )
        for plot, figure in figures:
            plot.update_figure(painted(figure, theme))

    def _is_new(self, figures: str, step: int) -> bool:
        """Tell whether a group of figures is due: after `step` [ns], or when a choice changed."""
        newest_sample, *choices = self._drawn
        shown = (newest_sample // step, *choices)
        before, self._plotted[figures] = self._plotted.get(figures), shown
        return shown != before

    def _show_nodes(self, found: list[str]) -> None:
        """Show the statuses that concern the device; one that is open stays open."""
        state = self._watch.state
        with state.lock:
            statuses = sorted(state.statuses.values(), key=lambda status: status.name)
        others = [name for name in found if name != self._watch.namespace]
        for status in statuses:
            if not concerns(status.name, self._watch.namespace, others):
                continue
            if status.name not in self._seen:
                with self._nodes, ui.expansion().classes('w-full') as row:
                    self._seen[status.name] = (row, ui.html('', sanitize=False))
            row, values = self._seen[status.name]
            level, line = headline(status, state.now())
            row.text = f'{level}: {line}'
            row.classes(replace=f'w-full live-{level}')
            if row.value:
                values.content = details(status)


def _card(title: str) -> Any:
    card = ui.element('section').classes('card live-card')
    with card:
        ui.html(f'<h2>{title}</h2>', sanitize=False)
    return card


def _plot(title: str, size: str) -> Any:
    with _card(title):
        plot = PlotElement({'data': [], 'layout': {}}).classes(f'w-full {size}')
        return plot.props(f'role=group aria-label="{title} over time"')


def _tiles(pairs: list[tuple[str, str]]) -> str:
    cells = ''.join(f'<div><dt>{name}</dt><dd>{value}</dd></div>' for name, value in pairs)
    return f'<dl>{cells}</dl>'


def _listener() -> Any:
    """Return the process's listener, started; ImportError or RuntimeError where ROS does not."""
    if os.environ.get('RMW_IMPLEMENTATION'):  # a wrong one ends the process that imports rclpy
        trial = subprocess.run(
            [sys.executable, '-c', 'import rclpy'], capture_output=True, text=True, check=False
        )
        if trial.returncode:
            lines = trial.stderr.strip().splitlines() or ['it ends without a message']
            raise RuntimeError(lines[-1])
    from imu_workbench.web.live.listener import shared_listener

    return shared_listener()
