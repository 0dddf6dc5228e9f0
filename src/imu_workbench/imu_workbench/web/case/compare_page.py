# SPDX-License-Identifier: Apache-2.0
"""Compare: the model against the measurement, and where it fails."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from nicegui import ui

from imu_workbench.report.figures.panels import Figure
from imu_workbench.web.case.failure_map import FailureMap, failure_figure, failure_map
from imu_workbench.web.case.noise_figures import allan_figure, spectrum_figure
from imu_workbench.web.case.scatter_figures import phase_figure, rate_figure, temperature_figure
from imu_workbench.web.case.time_figure import time_figure, time_lines
from imu_workbench.web.case.view import Place
from imu_workbench.web.plot import Look, Plot, figure_card
from imu_workbench.web.session import Session

LISTED_PLACES = 6
"""Number of worst places listed as buttons."""


class ComparePage:
    """The plots of one sensor and axis; all follow the chosen place."""

    def __init__(self, session: Session, look: Look, go_to: Callable[[Place | None], Any]) -> None:
        self._session, self._look, self._go_to = session, look, go_to
        self._map: FailureMap | None = None
        self._listed: tuple[list[tuple[Place, float]], Place | None] = ([], None)
        self._drawn = 0
        self._empty = ui.label('').classes('card soft')
        with ui.element('div').classes('grid-compare') as self._grid:
            with ui.element('div').classes('stack wide'):
                self._time = figure_card(
                    look, 'Measured, modelled and what is left',
                    'Error and temperature over time, residual below',
                )  # fmt: skip
                with ui.element('section').classes('card'):
                    title = 'Where it fails: residual in units of the noise floor'
                    ui.html(f'<h2>{title}</h2>', sanitize=False)
                    with ui.element('div').classes('map'):
                        self._where = Plot(look, 'Residual by phase, cycle and run, as a map')
                        self._cells = CellGrid(go_to)
            with ui.element('div').classes('stack'):
                with ui.element('section').classes('card'):
                    ui.html('<h2>Worst places</h2>', sanitize=False)
                    self._places = ui.element('div').classes('places')
                self._temperature = figure_card(
                    look, 'Residual against temperature',
                    'Residual against die temperature by branch and cycle',
                )  # fmt: skip
                self._rate = figure_card(
                    look, 'Residual against rate', 'Residual against the die temperature rate'
                )
            self._phase = figure_card(
                look, 'Residual by phase', 'Mean and spread of the residual per phase and cycle'
            )
            self._spectrum = figure_card(
                look, 'Spectrum of the residual', 'Amplitude density of the residual'
            )
            self._allan = figure_card(
                look, 'Allan deviation', 'Allan deviation of samples and residual'
            )
        self._where.on('plotly_click', self._on_cell)
        self._where.on('plotly_afterplot', js_handler='() => layCells()')
        self._time.on('plotly_relayout', self._on_zoom)

    @property
    def plots(self) -> list[Any]:
        """Every plot of the page."""
        return [
            self._time, self._where, self._temperature, self._rate, self._phase, self._spectrum,
            self._allan,
        ]  # fmt: skip

    async def refresh(self) -> None:
        """Draw everything anew."""
        self._drawn += 1
        mine = self._drawn
        state = self._session.state
        self._grid.visible, self._empty.visible = state is not None, state is None
        if state is None:
            self._empty.set_text(self._session.nothing_yet)
            for plot in self.plots:
                plot.show(None)
            self._places.clear()
            self._cells.show(None, None)
            self._listed = ([], None)
            return
        figures, found = await asyncio.to_thread(self._figures)
        if mine != self._drawn:
            return
        self._map = found
        for plot, figure in zip(self.plots, figures, strict=True):
            plot.show(figure)
        self._cells.show(found, self._session.view.place)
        self._show_places()

    def repaint(self) -> None:
        """Draw everything in the present look."""
        for plot in self.plots:
            plot.repaint()

    def _figures(self) -> tuple[list[Figure | None], FailureMap | None]:
        state, view = self._session.state, self._session.view
        if state is None:
            return [None] * 7, None
        version, bags = state.version, state.bags
        time = time_figure(bags, version, view, state.earlier_version)
        if version is None:
            return [time, *[None] * 6], None
        found = failure_map(version, view)
        return [
            time,
            failure_figure(found, view),
            temperature_figure(version, view),
            rate_figure(version, view),
            phase_figure(version, view) if found.by_phase else None,
            spectrum_figure(version, view),
            allan_figure(version, view, bags),
        ], found

    def _show_places(self) -> None:
        chosen = self._session.view.place
        worst = self._map.worst(LISTED_PLACES) if self._map else []
        if (worst, chosen) == self._listed:
            return  # a new list would take the keyboard's focus away
        self._listed = (worst, chosen)
        self._places.clear()
        with self._places:
            for place, ratio in worst:
                on = place == chosen
                button = ui.element('button').classes('place on' if on else 'place')
                button.props(f'type=button aria-pressed={"true" if on else "false"}')
                button.on('click', lambda _, place=place: self._go_to(place))
                with button:
                    ui.label(str(place))
                    ui.label(f'{ratio:.1f} ×').classes('number')
            if chosen is not None:
                button = ui.element('button').classes('place').props('type=button')
                button.on('click', lambda _: self._go_to(None))
                with button:
                    ui.label('Show everything')

    async def _on_cell(self, event: Any) -> None:
        point = (event.args.get('points') or [{}])[0]
        if self._map is None or 'x' not in point:
            return
        place = self._map.places[int(point['y'])][int(point['x'])]
        if place is not None:
            await self._go_to(place)

    async def _on_zoom(self, event: Any) -> None:
        state, window = self._session.state, window_of(event.args)
        if state is None or window == ():
            return
        shown = (window[0], window[1]) if window else None
        view, version, earlier = self._session.view, state.version, state.earlier_version
        self._drawn += 1
        mine = self._drawn
        lines = await asyncio.to_thread(time_lines, state.bags, version, view, shown, earlier)
        if mine == self._drawn:
            self._time.replace_lines(lines)


def window_of(change: dict[str, Any]) -> tuple[float, ...] | None:
    """Return the new range of the time axis; () where it has not changed, None for everything.

    >>> window_of({'xaxis.range[0]': 1, 'xaxis.range[1]': 2.5})
    (1.0, 2.5)
    >>> window_of({'xaxis.autorange': True}) is None, window_of({'yaxis.range[0]': 1})
    (True, ())
    """
    for axis in ('xaxis', 'xaxis3'):
        if f'{axis}.range[0]' in change and f'{axis}.range[1]' in change:
            return float(change[f'{axis}.range[0]']), float(change[f'{axis}.range[1]'])
        if f'{axis}.range' in change:
            return float(change[f'{axis}.range'][0]), float(change[f'{axis}.range'][1])
        if change.get(f'{axis}.autorange'):
            return None
    return ()


CellLabels = dict[Place, tuple[str, bool]]
"""Place → its label for screen readers, and whether it is the chosen one."""


class CellGrid:
    """Buttons over the cells of a map."""

    def __init__(self, go_to: Callable[[Place], Any]) -> None:
        self._go_to = go_to
        self._shape: tuple[tuple[Place | None, ...], ...] = ()
        self._buttons: dict[Place, ui.element] = {}
        self._labels: CellLabels = {}
        self._place = ui.element('div').classes('cells')
        self._place.props('role=grid aria-label="Where it fails: arrow keys move, Enter goes to"')

    def show(self, found: FailureMap | None, chosen: Place | None) -> None:
        """Show the cells of a map; the focus stays where the cells have not changed."""
        known = cell_labels(found, chosen)
        shape = found.places if found is not None and known else ()
        if shape != self._shape or known.keys() != self._labels.keys():
            self._build(shape, known, first_cell(found, chosen))
        for place, (label, on) in known.items():
            if (label, on) != self._labels.get(place):
                button = self._buttons[place]
                button.props['aria-label'] = label
                button.props['aria-selected'] = 'true' if on else 'false'
                button.update()
        self._labels = known

    def _build(
        self, shape: tuple[tuple[Place | None, ...], ...], known: CellLabels, start: Place | None
    ) -> None:
        self._place.clear()
        self._shape, self._buttons, self._labels = shape, {}, {}
        self._place.style(f'--columns: {len(shape[0]) if shape else 0}')
        with self._place:
            for places in shape:
                with ui.element('div').props('role=row'):
                    for place in places:
                        self._add(place if place in known else None, first=place == start)

    def _add(self, place: Place | None, *, first: bool) -> None:
        if place is None:
            ui.element('span').props('role=gridcell')
            return
        button = ui.element('button').props(
            f'type=button role=gridcell tabindex={0 if first else -1}'
        )
        button.on('click', lambda _, place=place: self._go_to(place))
        self._buttons[place] = button


def cell_labels(found: FailureMap | None, chosen: Place | None) -> CellLabels:
    """Return the label of every place that has a ratio."""
    if found is None:
        return {}
    return {
        place: (f'{place}: {ratio:.1f} × the noise floor', place == chosen)
        for places, ratios in zip(found.places, found.ratio, strict=True)
        for place, ratio in zip(places, ratios, strict=True)
        if place is not None and ratio is not None
    }


def first_cell(found: FailureMap | None, chosen: Place | None) -> Place | None:
    """Return the place that the Tab key reaches first: the chosen one, else the worst."""
    worst = found.worst(1) if found else []
    return chosen or (worst[0][0] if worst else None)
