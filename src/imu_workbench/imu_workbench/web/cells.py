# SPDX-License-Identifier: Apache-2.0
"""The cells of a map for the keyboard: one stop, arrow keys move, Enter goes there.

Buttons lie over the cells of the figure and let the mouse through to it; `cells.js` lays them
there and moves the focus.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

from imu_workbench.web.figure_failure import FailureMap
from imu_workbench.web.view import Place

Known = dict[Place, tuple[str, bool]]
"""What is read out of a place, and whether it is the one looked at."""


class CellGrid:
    """Buttons over the cells of a map."""

    def __init__(self, go_to: Callable[[Place], Any]) -> None:
        self._go_to = go_to
        self._shape: tuple[tuple[Place | None, ...], ...] = ()
        self._buttons: dict[Place, ui.element] = {}
        self._known: Known = {}
        self._place = ui.element('div').classes('cells')
        self._place.props('role=grid aria-label="Where it fails: arrow keys move, Enter goes to"')

    def show(self, found: FailureMap | None, chosen: Place | None) -> None:
        """Offer the cells of a map; what has the focus keeps it where the cells are the same."""
        known = known_places(found, chosen)
        shape = found.places if found is not None and known else ()
        if shape != self._shape or known.keys() != self._known.keys():
            self._build(shape, known, start_of(found, chosen))
        for place, (label, on) in known.items():
            if (label, on) != self._known.get(place):
                button = self._buttons[place]
                button.props['aria-label'] = label
                button.props['aria-selected'] = 'true' if on else 'false'
                button.update()
        self._known = known

    def _build(
        self, shape: tuple[tuple[Place | None, ...], ...], known: Known, start: Place | None
    ) -> None:
        self._place.clear()
        self._shape, self._buttons, self._known = shape, {}, {}
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


def known_places(found: FailureMap | None, chosen: Place | None) -> Known:
    """Return the places that hold a number."""
    if found is None:
        return {}
    return {
        place: (f'{place}: {ratio:.1f} × the noise floor', place == chosen)
        for places, ratios in zip(found.places, found.ratio, strict=True)
        for place, ratio in zip(places, ratios, strict=True)
        if place is not None and ratio is not None
    }


def start_of(found: FailureMap | None, chosen: Place | None) -> Place | None:
    """Return the place the keyboard comes to first: the one looked at, else the worst."""
    worst = found.worst(1) if found else []
    return chosen or (worst[0][0] if worst else None)
