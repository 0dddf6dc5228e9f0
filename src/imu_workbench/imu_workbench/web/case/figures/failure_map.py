# SPDX-License-Identifier: Apache-2.0
"""Map of where a model fails: phase × cycle × orientation, in units of the noise floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log10
from typing import Any

import numpy as np
from imu_recording.recording import PHASES, FloatArray

from imu_workbench.report.figures.modelled import FAILURE_COLOUR_SCALE, cell_numbers
from imu_workbench.report.figures.panels import Figure, Panel, figure, trace_axes
from imu_workbench.web.case.figures.run_blocks import RunBlocks
from imu_workbench.web.case.version import Version
from imu_workbench.web.case.view import PHASE_LABELS, Place, View

MIN_BLOCKS = 3
"""Blocks a cell needs at least."""
HORIZONTAL_COLOUR_BAR = {
    'orientation': 'h', 'y': 0, 'yanchor': 'top', 'ypad': 26, 'len': 0.9,
    'title': {'text': 'times the noise floor', 'side': 'top'},
}  # fmt: skip
"""The colour bar under the map, where there is no room beside it."""


@dataclass(frozen=True)
class FailureMap:
    """Residual per cell, columns run by run, an empty column between two runs."""

    rows: tuple[str, ...]
    """Label of each row."""
    columns: tuple[tuple[str, str], ...]
    """(run, label) of each column."""
    places: tuple[tuple[Place | None, ...], ...]
    """By row and column."""
    ratio: tuple[tuple[float | None, ...], ...]
    """Rms of the axis over its noise floor, by row and column."""
    by_phase: bool = True
    """Whether rows are phases; else they are bins of temperature."""

    def worst(self, count: int) -> list[tuple[Place, float]]:
        """Return the places with the largest ratios."""
        found = [
            (place, ratio)
            for places, ratios in zip(self.places, self.ratio, strict=True)
            for place, ratio in zip(places, ratios, strict=True)
            if place is not None and ratio is not None
        ]
        return sorted(found, key=lambda cell: -cell[1])[:count]


def failure_map(version: Version, view: View) -> FailureMap:
    """Return the map of one axis; by temperature where the runs have no phases."""
    blocks = version.blocks
    by_phase = any(bool((run.phase >= 0).any()) for run in blocks)
    keys = _phases(blocks) if by_phase else _bins(blocks)
    labels = [PHASE_LABELS[str(k)] if by_phase else f'{k} … {int(k) + 10} °C' for k in keys]
    floor = version.comparison['sensors'][view.sensor]['noise_floor'][view.axis] or np.nan
    columns: list[tuple[str, str]] = []
    cells: list[list[tuple[Place, RunBlocks] | None]] = []
    for number, run in enumerate(blocks):
        if number:
            columns.append((run.run, ''))
            cells.append([None] * len(keys))
        cycles = [int(c) for c in np.unique(run.cycle)] if by_phase else [0]
        for cycle in cycles:
            columns.append((run.run, f'R{cycle}' if cycle else '–'))
            cells.append([
                (Place(run.run, str(k), cycle) if by_phase else
                 Place(run.run, None, None, float(k)), run)
                for k in keys
            ])  # fmt: skip
    ratios = [[_ratio(cell, view, floor) for cell in column] for column in cells]
    return FailureMap(
        rows=tuple(labels),
        columns=tuple(columns),
        places=tuple(
            tuple(column[i][0] if column[i] else None for column in cells)  # type: ignore[index]
            for i in range(len(keys))
        ),
        ratio=tuple(tuple(column[i] for column in ratios) for i in range(len(keys))),
        by_phase=by_phase,
    )


def failure_figure(found: FailureMap, view: View) -> Figure:
    """Return the map as a heat map in the report's colours; the chosen place has a frame."""
    logarithms = [[None if r is None else log10(max(r, 1e-3)) for r in row] for row in found.ratio]
    data: list[dict[str, Any]] = [{
        'type': 'heatmap',
        'x': list(range(len(found.columns))),
        'y': list(range(len(found.rows))),
        'z': logarithms,
        'text': [['' if r is None else f'{r:.1f}' for r in row] for row in found.ratio],
        'customdata': [[str(place or '') for place in row] for row in found.places],
        'coloraxis': 'coloraxis',
        'xgap': 1.5,
        'ygap': 1.5,
        'hovertemplate': '%{customdata}: %{text} × the noise floor<extra>click to go there'
                         '</extra>',
        'hoverongaps': False,
        **trace_axes(0),
    }]  # fmt: skip
    if len(found.columns) <= 20:
        short = [
            ['' if r is None else f'{r:.1f}' if r < 9.95 else f'{r:.0f}' for r in row]
            for row in found.ratio
        ]
        data.append(cell_numbers(data[0], short))
    panel = Panel(
        'cycle', '',
        x={'tickvals': list(range(len(found.columns))), 'ticktext': [c for _, c in found.columns],
           'ticks': '', 'showgrid': False, 'showline': False, 'fixedrange': True,
           'tickangle': 0},
        y={'tickvals': list(range(len(found.rows))), 'ticktext': list(found.rows),
           'autorange': 'reversed', 'automargin': True, 'ticks': '', 'showgrid': False,
           'showline': False, 'fixedrange': True},
    )  # fmt: skip
    height = max(150, 39 * len(found.rows))
    spec = figure(
        data, [panel], height=height, shapes=_frame(found, view), coloraxis=FAILURE_COLOUR_SCALE
    )
    marks = _run_marks(found)
    for part in (spec['layout'], spec['narrow']):
        part['annotations'] = marks
        part['margin'] = part['margin'] | {'t': 26, 'l': 10, 'r': 6}
    spec['layout']['height'] -= 26
    spec['narrow']['coloraxis'] = {
        'colorbar': FAILURE_COLOUR_SCALE['colorbar'] | HORIZONTAL_COLOUR_BAR
    }
    spec['narrow']['height'] += 34
    spec['narrow']['margin']['b'] += 34
    spec['narrow']['xaxis'] |= {'ticktext': [''] * len(found.columns)}
    spec['layout']['dragmode'] = False
    return spec


def _frame(found: FailureMap, view: View) -> list[dict[str, object]]:
    return [
        {'type': 'rect', 'x0': j - 0.5, 'x1': j + 0.5, 'y0': i - 0.5, 'y1': i + 0.5,
         'line': {'color': '@model', 'width': 3}}
        for i, row in enumerate(found.places)
        for j, place in enumerate(row)
        if place is not None and place == view.place
    ]  # fmt: skip


def _run_marks(found: FailureMap) -> list[dict[str, object]]:
    marks = []
    for run in dict.fromkeys(run for run, _ in found.columns):
        own = [j for j, (name, label) in enumerate(found.columns) if name == run and label]
        marks.append({
            'text': run, 'x': sum(own) / len(own), 'y': 1, 'xref': 'x', 'yref': 'paper',
            'yanchor': 'bottom', 'showarrow': False, 'font': {'size': 11, 'color': '@soft'},
        })  # fmt: skip
    return marks


def _ratio(cell: tuple[Place, RunBlocks] | None, view: View, floor: float) -> float | None:
    if cell is None:
        return None
    place, run = cell
    values: FloatArray = run.residual(view.sensor)[place.rows(run), view.axis]
    values = values[np.isfinite(values)]
    if len(values) < MIN_BLOCKS or not floor > 0.0:
        return None
    return round(float(np.sqrt((values**2).mean())) / floor, 3)


def _phases(blocks: Sequence[RunBlocks]) -> list[str]:
    return [p for i, p in enumerate(PHASES) if any((run.phase == i).any() for run in blocks)]


def _bins(blocks: Sequence[RunBlocks]) -> list[int]:
    lows = {int(low) for run in blocks for low in np.floor(run.temperature / 10.0) * 10.0}
    return sorted(lows)
