# SPDX-License-Identifier: Apache-2.0
"""A Plotly figure: colours of the theme, layout for phones, label for screen readers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from typing import Any

from nicegui import ui

from imu_workbench.report.figures.palette import painted
from imu_workbench.report.figures.panels import Figure
from imu_workbench.web.words import with_help

REMOVED_BUTTONS = ['select2d', 'lasso2d', 'autoScale2d', 'toImage']
PLOTLY_CONFIG = {
    'displaylogo': False,
    'modeBarButtonsToRemove': [*REMOVED_BUTTONS, 'zoom2d', 'pan2d', 'zoomIn2d', 'zoomOut2d'],
}
"""Options of plotly.js: dragging zooms and, with Shift, moves, which needs no buttons."""


@dataclass
class Look:
    """How figures are shown in one tab."""

    dark: bool = False
    narrow: bool = False
    touch: bool = False
    """A finger scrolls the page over a figure; the buttons above it zoom."""

    @property
    def theme(self) -> str:
        """Key of the palette."""
        return 'dark' if self.dark else 'light'


def options_of(figure: Figure, look: Look) -> dict[str, Any]:
    """Return what plotly.js draws: data, layout, config."""
    layout, data = dict(figure['layout']), figure['data']
    if look.narrow:
        for key, change in figure['narrow'].items():
            before = layout.get(key)
            nested = isinstance(change, dict) and isinstance(before, dict)
            layout[key] = dict(before or {}) | change if nested else change
        data = [{k: v for k, v in trace.items() if k != 'texttemplate'} for trace in data]
    if look.narrow or look.touch:
        layout['dragmode'] = False
    for key, axis in layout.items():
        if key.startswith(('xaxis', 'yaxis')) and 'title' in axis:
            font = {'size': 12, **axis['title'].get('font', {})}
            layout[key] = {**axis, 'title': {**axis['title'], 'font': font}}
        if key.startswith('yaxis') and 'overlaying' not in axis:
            layout[key]['automargin'] = True
    layout['legend'] = {**layout.get('legend', {}), 'font': {'size': 11.5}, 'itemwidth': 30}
    config = PLOTLY_CONFIG
    if look.narrow or look.touch:
        config = PLOTLY_CONFIG | {
            'displayModeBar': not look.narrow,
            'modeBarButtonsToRemove': REMOVED_BUTTONS,
        }
    options = {'data': data, 'layout': layout, 'config': config}
    result: dict[str, Any] = painted(options, look.theme)
    return result


class PlotElement(ui.plotly, component='figure.js'):  # type: ignore[call-arg, misc]
    """A figure in the browser, which draws it where it is near what is seen of the page."""


class Plot:
    """One figure; it is drawn again where the theme changes."""

    def __init__(self, look: Look, label: str, name: str = '') -> None:
        self._look, self._label, self._name = look, label, name
        self._figure: Figure | None = None
        self._drawn: dict[str, Any] = {}
        self._place = ui.element('div')
        self.card: ui.element | None = None
        """The card it stands in, where it has one of its own."""
        self._element: PlotElement | None = None
        self._handlers: list[tuple[str, dict[str, Any]]] = []

    def show(self, figure: Figure | None) -> None:
        """Draw a figure; None leaves the place empty."""
        self._figure = figure
        if figure is None:
            self._place.clear()
            self._place.style(replace='')
            self._element = None
            return
        options = options_of(figure, self._look)
        if self._element is not None:
            if options != self._drawn:  # drawing the same again takes as long as drawing it first
                self._element.update_figure(options)
                self._reserve(options)
            self._drawn = options
            return
        self._drawn = options
        with self._place:
            self._element = PlotElement(options).classes('plot')
        self._reserve(options)
        self._element.props(f'role=group aria-label="{self._label}" data-plot="{self._name}"')
        for event, handler in self._handlers:
            self._element.on(event, **handler)

    def _reserve(self, options: dict[str, Any]) -> None:
        """Keep the place free that the figure takes once it is drawn."""
        self._place.style(replace=f'min-height: {options["layout"]["height"]}px')

    def repaint(self) -> None:
        """Draw the same figure in the present look."""
        if self._figure is not None:
            self.show(self._figure)

    def on(
        self, event: str, handler: Callable[..., Any] | None = None, *, js_handler: str = ''
    ) -> None:
        """Call a handler on a Plotly event: of the server, or JavaScript in the browser."""
        self._handlers.append(
            (event, {'js_handler': js_handler} if js_handler else {'handler': handler})
        )


def figure_card(look: Look, title: str, label: str, name: str, classes: str = '') -> Plot:
    """Return a plot in a card with a heading; `name` is what a saved figure is called."""
    with ui.element('section').classes(f'card {classes}') as card:
        card_head(title)
        plot = Plot(look, label, name)
    plot.card = card
    return plot


def card_head(title: str) -> None:
    """Draw a heading with buttons that save the card's figure."""
    plain = escape(title)
    buttons = ''.join(
        f'<button type="button" class="save" data-save="{format_}" '
        f'aria-label="save “{plain}” as {format_.upper()}">{format_.upper()}</button>'
        for format_ in ('svg', 'png', 'csv')
    )
    head = f'<h2>{with_help(title)}</h2><span class="saves">{buttons}</span>'
    ui.html(head, sanitize=False).classes('card-head')
