# SPDX-License-Identifier: Apache-2.0
"""Buttons over the cells of a map, for the keyboard, a finger and screen readers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from imu_recording.recording import PHASES
from nicegui import ui

from imu_workbench.web.case.figures.failure_map import FailureMap
from imu_workbench.web.case.view import Place

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
        if place.phase is not None:
            number = PHASES.index(place.phase)
            button.props['data-cell'] = f'{place.run}|{number}|{place.cycle or 0}'
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
