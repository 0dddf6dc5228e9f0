# SPDX-License-Identifier: Apache-2.0
"""The bottom of the page: the tree of versions, the error of each, the coefficients."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import partial
from html import escape
from typing import Any

from nicegui import ui
from thermal_comp.presentation.display import (
    DISPLAY_UNITS,
    SENSORS,
    coefficient_unit,
    shown,
    with_uncertainty,
)

from imu_workbench.case import CaseVersion
from imu_workbench.report.figures.error_steps import logarithmic_axis
from imu_workbench.report.figures.panels import Figure, Panel, figure, trace_axes
from imu_workbench.report.model_content import in_words
from imu_workbench.web.case.buttons import Buttons, file_button
from imu_workbench.web.case.version import Version, parameter_text
from imu_workbench.web.plot import Look, Plot, card_head
from imu_workbench.web.session import Session
from imu_workbench.web.words import with_help

MOST_LABELS = 5
"""Steps up to which every one is labelled: as many as fit on a phone."""
MOST_NAMED_RUNS = 4
"""Runs of a version that are listed by name; more are counted."""


@dataclass(frozen=True)
class VersionActions:
    """What the panel asks the page to do."""

    show: Callable[[str], Any]
    save_model: Callable[[], Any]
    save_report: Callable[[], Any]
    save_case: Callable[[], Any]
    open_model: Callable[[str, bytes], Awaitable[None]]
    keep_statement: Callable[[str, bytes], Awaitable[None]]
    note: Callable[[str], Any]


class VersionsPanel:
    """Versions of the device's model; none is ever deleted."""

    def __init__(self, session: Session, look: Look, actions: VersionActions) -> None:
        self._session, self._look, self._actions = session, look, actions
        self._drawn: tuple[Any, ...] | None = None
        self._path: list[CaseVersion] = []
        self._noted: tuple[str, str] | None = None
        """Device and notes as they were shown last."""
        with ui.element('div').classes('bottom'):
            with ui.element('section').classes('card versions').props('aria-label="Versions"'):
                ui.html('<h2>Versions</h2>', sanitize=False)
                self._tree = ui.element('div').classes('scroll versions')
                self._rows = Buttons(self._tree)
                self._save_and_open()
                self._notes = ui.textarea('Notes', on_change=self._on_note)
                self._notes.props('dense outlined autogrow debounce=600').classes('notes')
            with ui.element('section').classes('card'):
                card_head('Error staircase')
                self._staircase = Plot(
                    look, 'Held-out error of every version per sensor', 'error_staircase'
                )
            with ui.element('section').classes('card coefficients'):
                ui.html(f'<h2>{with_help("Coefficients")}</h2>', sanitize=False)
                self._coefficients = ui.html('', sanitize=False).classes('scroll')
                self._remarks = ui.element('div')

    def _save_and_open(self) -> None:
        do = self._actions
        with ui.row().classes('actions'):
            self._model, self._report = (
                ui.button(label, on_click=act).props('no-caps outline')
                for label, act in (
                    ('Save the model', do.save_model),
                    ('Save the certificate', do.save_report),
                )
            )
            self._case = ui.button('Save the case', on_click=do.save_case).props('no-caps outline')
            self._case.tooltip('Everything of this device as a zip: versions, findings, notes')
            self._open = file_button('Open a model (.yaml)', '.yaml,.yml', do.open_model)
            self._state = file_button(
                'Laboratory or limits (.yaml)', '.yaml,.yml', do.keep_statement
            )
            self._state.tooltip(
                'What certificates state of laboratory, instruments and customer, or decide by: '
                'asked for once, kept in the case (see examples/laboratory.yaml, limits.yaml)'
            )

    def _on_note(self, event: Any) -> None:
        if self._session.work is not None and event.value != self._session.work.case.notes:
            self._actions.note(event.value)

    def refresh(self) -> None:
        """Show the versions of the device looked at."""
        session = self._session
        work, version = session.work, session.version
        known = work is not None and work.case.version(session.version_name) is not None
        self._model.set_enabled(known)
        self._report.set_enabled(version is not None)
        self._case.set_enabled(work is not None)
        self._state.set_enabled(work is not None)
        self._open.set_enabled(bool(work and work.bags))
        self._notes.set_enabled(work is not None)
        noted = (session.device, work.case.notes) if work else None
        if noted != self._noted:  # another device, or written in another tab
            self._noted = noted
            self._notes.value = noted[1] if noted else ''
        drawn = (
            session.device, session.version_name, session.view.sensor, id(version),
            work.case.versions if work else (), self._look.narrow,
            tuple(bag.run for bag in work.bags) if work else (),
        )  # fmt: skip
        if drawn == self._drawn:
            return
        self._drawn = drawn
        self._tree.clear()
        self._remarks.clear()
        if work is None:
            self._coefficients.content = ''
            return
        with self._tree:
            self._show_tree(work.case.tree())
        self._coefficients.content = (
            coefficients_html(version, session.view.sensor) if version else ''
        )
        if version is not None:
            with self._remarks:
                for text in version.unneeded:
                    ui.label(f'No longer needed: {text.replace("_", " ")}').classes('note')
                for text in version.notes:
                    ui.label(text).classes('note')

    def draw(self) -> None:
        """Draw the error of each version, once it is known how the browser shows figures."""
        work = self._session.work
        path = work.case.path_to(self._session.version_name) if work else []
        if path != self._path:
            self._path = path
            self._staircase.show(error_steps_figure(path) if path else None)

    def repaint(self) -> None:
        """Draw the error of each version in the present look."""
        self._staircase.repaint()

    def _show_tree(self, tree: Sequence[tuple[CaseVersion, int]]) -> None:
        sensors = [s for s in SENSORS if any(s in v.errors for v, _ in tree)]
        if self._look.narrow:  # more would be cut
            sensors = [s for s in sensors if s == self._session.view.sensor] or sensors[:1]
        self._tree.style(
            f'grid-template-columns: minmax(150px, 1fr) repeat({len(sensors)}, max-content)'
        )
        with ui.element('div').classes('tree-row head'):
            ui.label('Version: held-out error (× noise floor)')
            for sensor in sensors:
                ui.label(f'{sensor.capitalize()} [{DISPLAY_UNITS[sensor].unit}]')
        with ui.element('div').classes('tree').props('role=list aria-label="Versions"'):
            for version, depth in tree:
                self._tree_row(version, depth, sensors)

    def _tree_row(self, version: CaseVersion, depth: int, sensors: Sequence[str]) -> None:
        on = version.name == self._session.version_name
        with ui.element('div').classes('tree-row on' if on else 'tree-row') as row:
            row.props('role=listitem')
            button = ui.element('button').classes('version').props('type=button')
            button.props(f'aria-pressed={"true" if on else "false"}')
            button.style(f'margin-left: {16 * depth}px')
            self._rows.heard(button, version.name, partial(self._actions.show, version.name))
            with button:
                work = self._session.work
                runs = {bag.run for bag in work.bags} if work else set()
                branch = (
                    f'{version.name} {version.label.replace("_", " ")}{of_runs(version, runs)}'
                )
                ui.label(f'{"└ " if depth else ""}{branch}')
            for sensor in sensors:
                ui.label(error_text(version, sensor)).classes('number')


def of_runs(version: CaseVersion, runs: Set[str]) -> str:
    """Return which runs the errors of a version are of, where they are not those that are open.

    >>> of_runs(CaseVersion('v1', None, 'line', recordings=('a', 'b')), {'b', 'c'})
    ', of a, b'
    """
    own = version.recordings
    if not own or not runs or set(own) == runs:
        return ''
    return f', of {", ".join(own) if len(own) <= MOST_NAMED_RUNS else f"{len(own)} runs"}'


def error_text(version: CaseVersion, sensor: str) -> str:
    """Return the held-out error of a version with its ratio to the floor."""
    errors = version.errors.get(sensor)
    if not errors:
        return '–'
    value = shown(errors['error'] * DISPLAY_UNITS[sensor].factor)
    return f'{value} ({errors["error"] / errors["floor"]:.2f} ×)' if errors['floor'] else value


def coefficients_html(version: Version, sensor: str) -> str:
    """Return the coefficients of one sensor, with shape parameters, ± and units, as a table."""
    rows = ''
    for row in (row for row in version.coefficients if row['sensor'] == sensor):
        unit = coefficient_unit(sensor, row['unit'])
        texts = [
            with_uncertainty(value * unit.factor, sigma * unit.factor)
            for value, sigma in zip(row['value'], row['uncertainty'], strict=True)
        ]
        cells = ''.join(f'<td>{escape(text)}</td>' for text in texts)
        if row['shared']:
            cells = f'<td colspan="3">{escape(texts[0])}</td>'
        name = escape(in_words(row['effect']))
        rows += f'<tr><th scope="row">{name}</th>{cells}<td>{escape(unit.unit)}</td></tr>'
    for term in (term for term in version.terms if term['sensor'] == sensor):
        name = escape(f'{term["effect"]}: {term["parameter"]}'.replace('_', ' '))
        text = escape(parameter_text(term['value'], term['std']))
        rows += (
            f'<tr><th scope="row">{name}</th><td colspan="3">{text}</td>'
            f'<td>{escape(term["unit"])}</td></tr>'
        )
    caption = f'{sensor.capitalize()}, ± one standard deviation if the model lacks nothing'
    return (
        f'<table tabindex="0"><caption>{caption}</caption><thead><tr><th>Term</th><th>x</th>'
        f'<th>y</th><th>z</th><th>Unit</th></tr></thead><tbody>{rows}</tbody></table>'
    )


def error_steps_figure(path: Sequence[CaseVersion]) -> Figure:
    """Return error over version, a panel per sensor; the floor is a dashed line.

    Of many versions only the first and the last carry their number: labels would touch.
    """
    sensors = [s for s in SENSORS if all(s in v.errors for v in path)]
    names = ['none', *(version.name for version in path)]
    labels = ['no model', *(version.label.replace('_', ' ') for version in path)]
    data, panels, shapes = [], [], []
    for i, sensor in enumerate(sensors):
        unit, factor = DISPLAY_UNITS[sensor].unit, DISPLAY_UNITS[sensor].factor
        errors: list[Mapping[str, float]] = [version.errors[sensor] for version in path]
        values = [errors[0]['measured'] * factor, *(e['error'] * factor for e in errors)]
        floor = errors[-1]['floor'] * factor
        last = len(values) - 1
        labelled = {0, last} if last > MOST_LABELS else range(last + 1)
        data.append({
            'type': 'scatter', 'mode': 'lines+markers+text', 'showlegend': False,
            'name': sensor, 'x': names, 'y': [float(f'{v:.5g}') for v in values],
            'line': {'shape': 'hvh', 'color': '@model', 'width': 2},
            'marker': {'size': [13 if k == last else 8 for k in range(len(values))],
                       'color': '@model'},
            'text': [shown(v) if k in labelled else '' for k, v in enumerate(values)],
            'textposition': 'top center',
            'textfont': {'size': 11}, 'cliponaxis': False, 'customdata': labels,
            'hovertemplate': f'%{{customdata}}: %{{y:.3~g}} {unit}<extra></extra>',
            **trace_axes(i),
        })  # fmt: skip
        place = trace_axes(i)
        shapes.append({
            'type': 'line', 'xref': f'{place["xaxis"]} domain', 'yref': place['yaxis'],
            'x0': 0, 'x1': 1, 'y0': floor, 'y1': floor,
            'line': {'color': '@soft', 'dash': 'dash', 'width': 1.6},
        })  # fmt: skip
        panels.append(
            Panel('model', f'held-out rms [{unit}]' if i == 0 else f'[{unit}]',
                  title=f'{sensor.capitalize()} (floor {shown(floor)} {unit})',
                  x={'type': 'category', 'range': [-0.5, len(names) - 0.5], 'showgrid': False},
                  y=logarithmic_axis([*values, floor]))
        )  # fmt: skip
    spec = figure(data, panels, columns=3, height=210, linked=False, shapes=shapes)
    spec['layout']['margin']['t'] = spec['narrow']['margin']['t'] = 30
    spec['layout']['height'] -= 20
    return spec
