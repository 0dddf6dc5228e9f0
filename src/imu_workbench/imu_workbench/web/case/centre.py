# SPDX-License-Identifier: Apache-2.0
"""The linked plots of a version: one cursor through all, and one window of time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any

from nicegui import ui

from imu_workbench.report.figures.panels import Figure
from imu_workbench.web.case.buttons import Buttons
from imu_workbench.web.case.figures.cell_grid import CellGrid
from imu_workbench.web.case.figures.failure_map import FailureMap, failure_figure, failure_map
from imu_workbench.web.case.figures.noise import allan_figure, spectrum_figure
from imu_workbench.web.case.figures.scatter import phase_figure, rate_figure, temperature_figure
from imu_workbench.web.case.figures.time_course import time_figure
from imu_workbench.web.case.preview import EffectPreview
from imu_workbench.web.case.version import Version
from imu_workbench.web.case.view import Place, View
from imu_workbench.web.plot import Look, Plot, card_head, figure_card
from imu_workbench.web.session import Session

LISTED_PLACES = 6
"""Number of worst places listed as buttons."""


class Centre:
    """The plots of one sensor and axis; all follow the chosen place or part of the time."""

    def __init__(
        self,
        session: Session,
        look: Look,
        go_to: Callable[[Place | None], Any],
        brush: Callable[[tuple[float, float] | None], Any],
    ) -> None:
        self._session, self._look = session, look
        self._go_to, self._brush = go_to, brush
        self._map: FailureMap | None = None
        self._listed: tuple[Any, ...] = ()
        self._drawn: tuple[Any, ...] | None = None
        self._turn = 0
        self._empty = ui.label('').classes('card soft')
        with ui.element('div').classes('centre') as self._grid:
            self._time = figure_card(
                look, 'Measured, modelled and what is left',
                'Error and temperature over time, residual below', 'error_over_time', 'wide',
            )  # fmt: skip
            with ui.element('section').classes('card wide map-card'):
                card_head('Where it fails: residual in units of the noise floor')
                with ui.element('div').classes('map'):
                    self._where = Plot(
                        look, 'Residual by phase, cycle and run, as a map', 'where_it_fails'
                    )
                    self._cells = CellGrid(go_to)
                with ui.element('div').classes('map-side'):
                    self._places = ui.element('div').classes('places')
                    self._places.props('role=group aria-label="worst places"')
                    self._buttons = Buttons(self._places)
                    self._all = ui.element('button').classes('place all').props('type=button')
                    self._all.on('click', lambda _: brush(None))
                    self._all.visible = False
                    with self._all:
                        ui.label('Show everything')
            self._temperature = figure_card(
                look, 'Residual against temperature',
                'Residual against die temperature by branch and cycle', 'residual_by_temperature',
                'half',
            )  # fmt: skip
            self._rate = figure_card(
                look, 'Residual against rate', 'Residual against the die temperature rate',
                'residual_by_rate', 'half',
            )  # fmt: skip
            self._phase = figure_card(
                look, 'Residual by phase', 'Mean and spread of the residual per phase and cycle',
                'residual_by_phase',
            )  # fmt: skip
            self._spectrum = figure_card(
                look, 'Spectrum of the residual', 'Amplitude density of the residual', 'spectrum'
            )
            self._allan = figure_card(
                look, 'Allan deviation', 'Allan deviation of samples and residual',
                'allan_deviation',
            )  # fmt: skip
        self._where.on('plotly_click', self._on_cell)
        self._where.on('plotly_afterplot', js_handler='() => layCells()')
        self._time.on('plotly_relayout', self._on_zoom)
        for plot, name in (
            (self._time, 'error_over_time'),
            (self._temperature, 'residual_by_temperature'),
            (self._rate, 'residual_by_rate'),
        ):
            plot.on('plotly_hover', js_handler=f'(event) => linkCursor("{name}", event)')
            plot.on('plotly_unhover', js_handler=f'() => linkCursor("{name}", null)')

    @property
    def plots(self) -> list[Plot]:
        """Every plot."""
        return [
            self._time, self._where, self._temperature, self._rate, self._phase, self._spectrum,
            self._allan,
        ]  # fmt: skip

    def show_place(self) -> bool:
        """Show the area of the figures, or why there are none; return whether there are any."""
        work = self._session.work
        there = work is not None and bool(work.bags)
        self._grid.visible, self._empty.visible = there, not there
        self._empty.set_text(self._session.nothing_yet)
        return there

    async def refresh(self, preview: EffectPreview | None) -> None:
        """Draw what has changed."""
        session = self._session
        work, version = session.work, session.version
        names = f'{session.device}_{session.version_name}_{session.view.sensor}'
        self._grid.props(f'data-stem="{names}_{session.view.axis_name}"')
        if not self.show_place() or work is None:
            self._clear()
            return
        drawn = (
            session.device, [bag.folder for bag in work.bags], id(version),
            id(session.earlier_version), session.view, id(preview),
        )  # fmt: skip
        if drawn == self._drawn:
            return
        self._drawn = drawn
        self._turn += 1
        mine = self._turn
        figures, found = await asyncio.to_thread(
            figures_of, work.bags, version, session.earlier_version, session.view, preview
        )
        if mine != self._turn:
            return
        self._map = found
        for plot, figure in zip(self.plots, figures, strict=True):
            plot.show(figure)
        if self._phase.card is not None and version is not None:
            self._phase.card.visible = found is not None and found.by_phase
        self._cells.show(found, session.view.place)
        self._show_places()

    def repaint(self) -> None:
        """Draw everything in the present look."""
        for plot in self.plots:
            plot.repaint()

    def _clear(self) -> None:
        self._drawn, self._map = None, None
        self._turn += 1
        for plot in self.plots:
            plot.show(None)
        self._cells.show(None, None)
        self._show_places()

    def _show_places(self) -> None:
        view = self._session.view
        worst = self._map.worst(LISTED_PLACES) if self._map else []
        self._all.visible = view.place is not None or view.window is not None
        if (worst, view.place) == self._listed:
            return
        self._listed = (worst, view.place)
        self._places.clear()
        with self._places:
            for place, ratio in worst:
                on = place == view.place
                button = ui.element('button').classes('place on' if on else 'place')
                button.props(f'type=button aria-pressed={"true" if on else "false"}')
                self._buttons.heard(button, f'go to {place}', partial(self._go_to, place))
                with button:
                    ui.label(str(place))
                    ui.label(f'{ratio:.1f} ×').classes('number')

    async def _on_cell(self, event: Any) -> None:
        point = (event.args.get('points') or [{}])[0]
        if self._map is None or 'x' not in point:
            return
        place = self._map.places[int(point['y'])][int(point['x'])]
        if place is not None:
            await self._go_to(place)

    async def _on_zoom(self, event: Any) -> None:
        window = window_of(event.args)
        if self._session.work is None or window == ():
            return
        await self._brush((window[0], window[1]) if window else None)


def figures_of(
    bags: Any,
    version: Version | None,
    earlier: Version | None,
    view: View,
    preview: EffectPreview | None,
) -> tuple[list[Figure | None], FailureMap | None]:
    """Return the figures in the order of `Centre.plots`, and the map of where it fails."""
    shown = preview if preview is not None and preview.sensor == view.sensor else None
    if version is None or view.sensor not in version.comparison['sensors']:
        measured = view.sensor if version is None else next(iter(version.comparison['sensors']))
        time = time_figure(bags, None, View(measured, view.axis, None, view.window))
        return [time, *[None] * 6], None
    earlier = earlier if earlier and view.sensor in earlier.comparison['sensors'] else None
    found = failure_map(version, view)
    return [
        time_figure(bags, version, view, earlier, shown),
        failure_figure(found, view),
        temperature_figure(version, view, shown),
        rate_figure(version, view, shown),
        phase_figure(version, view) if found.by_phase else None,
        spectrum_figure(version, view),
        allan_figure(version, view, bags),
    ], found


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
