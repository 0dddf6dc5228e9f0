# SPDX-License-Identifier: Apache-2.0
"""Add: tick an effect, watch the error fall; undo, compare versions, save."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from nicegui import events, ui
from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS, shown

from imu_workbench.report.figures.panels import Figure, Panel, figure, trace_axes
from imu_workbench.web.case.version import Version, parameter_text
from imu_workbench.web.plot import Look, Plot
from imu_workbench.web.session import Session

_NO_VERSION = -1


@dataclass(frozen=True)
class AddActions:
    """What the page asks the tab to do."""

    add: Callable[[str, list[str]], Awaitable[None]]
    remove: Callable[[str, list[str]], Awaitable[None]]
    undo: Callable[[], Awaitable[None]]
    show_version: Callable[[int], Awaitable[None]]
    compare_with: Callable[[int | None], Awaitable[None]]
    save_model: Callable[[], None]
    save_report: Callable[[], Awaitable[None]]
    load_model: Callable[[str, bytes], Awaitable[None]]
    load_effects: Callable[[str, bytes], Awaitable[None]]


class AddPage:
    """The effects as a list to tick, the staircase of errors, the versions."""

    def __init__(self, session: Session, look: Look, actions: AddActions) -> None:
        self._session, self._look = session, look
        self._actions = actions
        with ui.element('div').classes('grid-add'):
            with ui.element('section').classes('card'):
                ui.html('<h2>Effects in the model</h2>', sanitize=False)
                self._ticks = ui.element('div').classes('ticks')
                self._uploads()
            with ui.element('div').classes('stack'):
                with ui.element('section').classes('card'):
                    ui.html('<h2>Error staircase</h2>', sanitize=False)
                    self._staircase = Plot(look, 'Held-out error of every version per sensor')
                    self._remarks = ui.element('div')
                with ui.element('section').classes('card'):
                    ui.html('<h2>Versions</h2>', sanitize=False)
                    self._versions = ui.element('div')
                    self._selects()
                    self._buttons()

    def _selects(self) -> None:
        # Made once: a list that is open stays open while the versions are drawn again.
        with ui.row().classes('actions') as self._choices:
            self._shown = ui.select(
                {}, label='Show', on_change=lambda event: self._on_show(event.value)
            )
            self._earlier = ui.select(
                {}, label='Compare with', on_change=lambda event: self._on_compare(event.value)
            )
            for select in (self._shown, self._earlier):
                select.props('dense outlined options-dense').classes('choice')
        self._choices.set_visibility(False)

    async def _on_show(self, version: int | None) -> None:
        state = self._session.state
        if state is not None and version is not None and version != state.current:
            await self._actions.show_version(version)

    async def _on_compare(self, version: int | None) -> None:
        earlier = None if version == _NO_VERSION else version
        state = self._session.state
        if state is not None and version is not None and earlier != state.earlier:
            await self._actions.compare_with(earlier)

    def _buttons(self) -> None:
        with ui.row().classes('actions'):
            self._undo = ui.button('Undo', on_click=self._actions.undo).props('no-caps outline')
            self._save = ui.button('Save the model', on_click=self._actions.save_model)
            self._save.props('no-caps unelevated')
            self._report = ui.button('Save the report', on_click=self._actions.save_report)
            self._report.props('no-caps outline')

    def _uploads(self) -> None:
        async def effects(event: events.UploadEventArguments) -> None:
            await self._actions.load_effects(event.file.name, await event.file.read())

        async def model(event: events.UploadEventArguments) -> None:
            await self._actions.load_model(event.file.name, await event.file.read())

        with ui.row().classes('actions'):
            for label, accept, handler in (
                ('Load an effect file (.py)', '.py', effects),
                ('Open a model (.yaml)', '.yaml,.yml', model),
            ):
                upload = ui.upload(on_upload=handler, auto_upload=True, max_file_size=20_000_000)
                upload.props(f'accept="{accept}"').classes('hidden-upload')
                ui.button(
                    label, on_click=lambda _, upload=upload: upload.run_method('pickFiles')
                ).props('no-caps outline')

    async def refresh(self) -> None:
        """Show the versions of the device looked at."""
        self._show_ticks()
        self._show_versions()
        state = self._session.state
        ready = state is not None and state.version is not None
        self._staircase.show(
            error_steps_figure(state.versions, state.current) if state and ready else None
        )
        self._undo.set_enabled(bool(state and state.current > 0))
        self._save.set_enabled(ready)
        self._report.set_enabled(ready)

    def repaint(self) -> None:
        """Draw the staircase in the present look."""
        self._staircase.repaint()

    def _show_ticks(self) -> None:
        self._ticks.clear()
        state = self._session.state
        version = state.version if state else None
        with self._ticks:
            if state is None or version is None:
                ui.label(self._session.nothing_yet).classes('soft')
                return
            sensor = self._session.view.sensor
            ui.html(
                f'<p class="soft">Of the {sensor}; choose another sensor above. Ticking refits '
                'the whole model.</p>',
                sanitize=False,
            )
            inside = version.effects.get(sensor, ())
            for name, effect in self._session.effects.items():
                if sensor not in effect['sensors']:
                    continue
                if not effect['searched'] and name not in inside:
                    continue  # not added by its name: `auto` adds it, or a model began with it
                reason = state.unusable.get(name, '')
                box = ui.checkbox(
                    name.replace('_', ' '),
                    value=name in inside,
                    on_change=lambda event, name=name: self._on_tick(name, event.value),
                )
                box.props('dense')
                if reason:
                    box.set_enabled(False)
                    ui.label(reason).classes('reason')

    async def _on_tick(self, name: str, wanted: bool) -> None:
        sensor = self._session.view.sensor
        action = self._actions.add if wanted else self._actions.remove
        await action(name, [sensor])

    def _show_versions(self) -> None:
        self._versions.clear()
        self._remarks.clear()
        state = self._session.state
        self._choices.set_visibility(state is not None and state.version is not None)
        if state is None or state.version is None:
            return
        with self._remarks:
            ui.html(parameters_html(state.version.terms), sanitize=False)
            for text in state.version.unneeded:
                ui.label(f'No longer needed: {text.replace("_", " ")}').classes('note')
            for text in state.version.notes:
                ui.label(text).classes('note')
        with self._versions, ui.element('div').classes('scroll'):
            sensors = self._session.sensors()
            heads = ''.join(
                f'<th>{s.capitalize()}<br>[{DISPLAY_UNITS[s].unit}]</th>' for s in sensors
            )
            rows = ''.join(self._row(number, sensors) for number in range(len(state.versions)))
            ui.html(
                f'<table><caption>Held-out rms (× noise floor)</caption><thead><tr><th>Version'
                f'</th>{heads}</tr></thead><tbody>{rows}</tbody></table>',
                sanitize=False,
            )
        names = {i: f'v{i + 1}' for i in range(len(state.versions))}
        self._shown.set_options(names, value=state.current)
        self._earlier.set_options(
            {_NO_VERSION: 'nothing'} | names,
            value=_NO_VERSION if state.earlier is None else state.earlier,
        )

    def _row(self, number: int, sensors: list[str]) -> str:
        state = self._session.state
        assert state is not None  # noqa: S101 (rows are of its versions)
        version = state.versions[number]
        cells = ''
        for sensor in sensors:
            error, floor = version.error(sensor), version.floor(sensor)
            value = shown(error * DISPLAY_UNITS[sensor].factor)
            cells += f'<td>{value} <span class="soft">({error / floor:.2f} ×)</span></td>'
        mark = ' class="on"' if number == state.current else ''
        return (
            f'<tr{mark}><th scope="row">v{number + 1} {escape(version.label.replace("_", " "))}'
            f'</th>{cells}</tr>'
        )


def parameters_html(terms: Any) -> str:
    """Return the shape parameters of a version as a list."""
    items = ''.join(
        f'<dt>{escape(term["effect"].replace("_", " "))}, {escape(term["sensor"])}: '
        f'{escape(term["parameter"].replace("_", " "))}</dt>'
        f'<dd>{escape(parameter_text(term["value"], term["std"]))} {escape(term["unit"])}</dd>'
        for term in terms
    )
    return f'<dl class="pairs">{items}</dl>' if items else ''


def error_steps_figure(versions: Sequence[Version], current: int) -> Figure:
    """Return error over version, a panel per sensor; the floor is a dashed line."""
    sensors = [s for s in SENSORS if s in versions[0].comparison['sensors']]
    names = ['none', *(f'v{i + 1}' for i in range(len(versions)))]
    data, panels, shapes = [], [], []
    for i, sensor in enumerate(sensors):
        unit, factor = DISPLAY_UNITS[sensor].unit, DISPLAY_UNITS[sensor].factor
        errors = [versions[0].measured(sensor), *(v.error(sensor) for v in versions)]
        values = [value * factor for value in errors]
        floor = versions[current].floor(sensor) * factor
        labels = ['no model', *(version.label for version in versions)]
        data.append({
            'type': 'scatter', 'mode': 'lines+markers+text', 'showlegend': False,
            'name': sensor, 'x': names, 'y': [float(f'{v:.5g}') for v in values],
            'line': {'shape': 'hvh', 'color': '@compensated', 'width': 2},
            'marker': {'size': [13 if k == current + 1 else 8 for k in range(len(values))],
                       'color': '@compensated'},
            'text': [shown(v) for v in values], 'textposition': 'top center',
            'textfont': {'size': 11}, 'cliponaxis': False, 'customdata': labels,
            'hovertemplate': f'%{{customdata}}: %{{y:.3~g}} {unit}<extra></extra>',
            **trace_axes(i),
        })  # fmt: skip
        place = trace_axes(i)
        shapes.append({
            'type': 'line', 'xref': f'{place["xaxis"]} domain', 'yref': place['yaxis'],
            'x0': 0, 'x1': 1, 'y0': floor, 'y1': floor,
            'line': {'color': '@z', 'dash': 'dash', 'width': 1.6},
        })  # fmt: skip
        panels.append(
            Panel('model', f'held-out rms [{unit}]' if i == 0 else f'[{unit}]',
                  title=f'{sensor.capitalize()} (floor {shown(floor)})',
                  x={'type': 'category', 'range': [-0.5, len(names) - 0.5], 'showgrid': False},
                  y={'type': 'log', 'dtick': 1, 'range': _decades([*values, floor])})
        )  # fmt: skip
    spec = figure(data, panels, columns=3, height=210, linked=False, shapes=shapes)
    spec['layout']['margin']['t'] = spec['narrow']['margin']['t'] = 30
    spec['layout']['height'] -= 20
    return spec


def _decades(values: Sequence[float]) -> list[float]:
    from math import log10

    known = [v for v in values if v > 0.0] or [1.0]
    return [log10(min(known) / 2.5), log10(max(known) * 3.0)]
