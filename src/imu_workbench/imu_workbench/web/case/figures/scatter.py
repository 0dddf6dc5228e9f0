# SPDX-License-Identifier: Apache-2.0
"""Figures of the residual against die temperature, its rate, and phase."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from imu_recording.recording import PHASES, FloatArray
from numpy.typing import NDArray
from thermal_comp.presentation.display import DISPLAY_UNITS

from imu_workbench.report.figures.measured import curve
from imu_workbench.report.figures.panels import Figure, Panel, figure, trace_axes
from imu_workbench.report.series import rounded
from imu_workbench.web.case.figures.time_course import cursor_trace, noise_band
from imu_workbench.web.case.preview import EffectPreview
from imu_workbench.web.case.version import Version
from imu_workbench.web.case.view import View, inside_window

MOST_DRAWN_POINTS = 900
"""Points drawn at most of one set."""
STEADY_RATE_C_PER_MIN = 0.2
"""A block whose die temperature changes more slowly is neither heating nor cooling."""
LEAST_BIN_ROWS = 5
"""Rows of a bin whose mean is drawn."""
BRANCH_COLOURS = {'heating': '@hot', 'cooling': '@cold', 'steady': '@raw'}
CYCLE_SYMBOLS = ('circle', 'square', 'diamond', 'triangle-up', 'cross', 'star')
PHASE_SHORT = {
    'precondition': 'ref.', 'ramp_down': 'ramp<br>down', 'dwell_cold': 'cold',
    'ramp_up': 'ramp<br>up', 'dwell_hot': 'hot', 'dwell_reference': 'amb.', 'final': 'final',
}  # fmt: skip


class _Rows:
    """Block means of all runs, concatenated."""

    def __init__(self, version: Version, view: View, preview: EffectPreview | None = None) -> None:
        blocks = version.blocks
        factor = DISPLAY_UNITS[view.sensor].factor
        self.unit = DISPLAY_UNITS[view.sensor].unit
        self.residual: FloatArray = factor * np.concatenate(
            [run.residual(view.sensor)[:, view.axis] for run in blocks]
        )
        self.temperature: FloatArray = np.concatenate([run.temperature for run in blocks])
        self.rate: FloatArray = np.concatenate([run.rate for run in blocks])
        self.phase = np.concatenate([run.phase for run in blocks])
        self.cycle = np.concatenate([run.cycle for run in blocks])
        self.explained: FloatArray | None = None
        if preview is not None and all(run.run in preview.curves for run in blocks):
            curves = [preview.curves[run.run][:, view.axis] for run in blocks]
            self.explained = factor * np.concatenate(curves)
        inside = inside_window(blocks, version.timeline, view.window)
        self.good: NDArray[np.bool_] = np.isfinite(self.residual) & inside
        self.chosen: NDArray[np.bool_] = (
            np.concatenate([view.place.rows(run) for run in blocks])
            if view.place
            else np.zeros(len(self.residual), dtype=bool)
        )

    def branch(self, name: str) -> NDArray[np.bool_]:
        if name == 'heating':
            return np.asarray(self.rate > STEADY_RATE_C_PER_MIN)
        return np.asarray(
            self.rate < -STEADY_RATE_C_PER_MIN
            if name == 'cooling'
            else np.abs(self.rate) <= STEADY_RATE_C_PER_MIN
        )


def temperature_figure(
    version: Version, view: View, preview: EffectPreview | None = None
) -> Figure:
    """Return the residual against temperature: colour by branch, symbol by cycle."""
    rows = _Rows(version, view, preview)
    data: list[dict[str, Any]] = []
    every = max(1, int(rows.good.sum()) // MOST_DRAWN_POINTS)
    for branch, colour in BRANCH_COLOURS.items():
        for cycle in np.unique(rows.cycle).tolist():
            inside = rows.good & rows.branch(branch) & (rows.cycle == cycle)
            picked = np.flatnonzero(inside)[::every]
            if not len(picked):
                continue
            label = f'{branch}, cycle {cycle}' if cycle else f'{branch}, outside the cycles'
            data.append({
                'type': 'scatter', 'mode': 'markers', 'name': label, 'showlegend': False,
                'x': rounded(rows.temperature[picked]), 'y': rounded(rows.residual[picked], 4),
                'marker': {'color': colour, 'size': 4, 'symbol': CYCLE_SYMBOLS[cycle % 6],
                           'opacity': 0.18 if view.place else 0.4},
                'hovertemplate': f'{label}: %{{y:.3~g}} {rows.unit} at %{{x:.1f}} °C'
                                 '<extra></extra>',
                **trace_axes(0),
            })  # fmt: skip
        inside = rows.good & rows.branch(branch)
        if branch != 'steady':
            mean = binned_mean(rows.temperature[inside], rows.residual[inside], 2.0)
            data.append(curve(mean, f'{branch} (mean)', trace_axes(0), color=colour, width=2.5))
    data += _chosen(rows, rows.temperature, view)
    data += _explained(rows, rows.temperature, preview)
    panel = Panel('die temperature [°C]', f'residual [{rows.unit}]')
    return _finished(data, panel, version, view)


def rate_figure(version: Version, view: View, preview: EffectPreview | None = None) -> Figure:
    """Return the residual against the rate of the die temperature."""
    rows = _Rows(version, view, preview)
    picked = np.flatnonzero(rows.good)[:: max(1, int(rows.good.sum()) // MOST_DRAWN_POINTS)]
    data: list[dict[str, Any]] = [{
        'type': 'scatter', 'mode': 'markers', 'name': 'block means', 'showlegend': False,
        'x': rounded(rows.rate[picked]), 'y': rounded(rows.residual[picked], 4),
        'marker': {'color': '@raw', 'size': 4, 'opacity': 0.18 if view.place else 0.4},
        'hovertemplate': f'%{{y:.3~g}} {rows.unit} at %{{x:.2f}} °C/min<extra></extra>',
        **trace_axes(0),
    }]  # fmt: skip
    mean = binned_mean(rows.rate[rows.good], rows.residual[rows.good], 0.1)
    data.append(curve(mean, 'mean', trace_axes(0), color=f'@{view.axis_name}', width=2.5))
    data += _chosen(rows, rows.rate, view)
    data += _explained(rows, rows.rate, preview)
    panel = Panel('rate of the die temperature [°C/min]', f'residual [{rows.unit}]')
    return _finished(data, panel, version, view)


def phase_figure(version: Version, view: View) -> Figure:
    """Return mean and standard deviation of the residual per phase, a mark per cycle."""
    rows = _Rows(version, view)
    phases = [i for i in range(len(PHASES)) if (rows.phase == i).any()]
    cycles = np.unique(rows.cycle).tolist()
    data: list[dict[str, Any]] = []
    for number, cycle in enumerate(cycles):
        x, y, spread = [], [], []
        for place, phase in enumerate(phases):
            values = rows.residual[rows.good & (rows.phase == phase) & (rows.cycle == cycle)]
            if len(values):
                x.append(place + 0.12 * (number - (len(cycles) - 1) / 2.0))
                y.append(float(values.mean()))
                spread.append(float(values.std()))
        label = f'R{cycle}' if cycle else 'other'
        colour = f'@{view.axis_name}'
        data.append({
            'type': 'scatter', 'mode': 'markers', 'name': label, 'x': x, 'y': y,
            'error_y': {'array': spread, 'thickness': 1.2, 'width': 0, 'color': colour},
            'marker': {'color': colour, 'size': 7, 'symbol': CYCLE_SYMBOLS[cycle % 6]},
            'hovertemplate': f'{label}: %{{y:.3~g}} ± %{{error_y.array:.2~g}} {rows.unit}'
                             '<extra></extra>',
            **trace_axes(0),
        })  # fmt: skip
    panel = Panel(
        '', f'residual [{rows.unit}]',
        x={'tickvals': list(range(len(phases))), 'showgrid': False, 'tickangle': 0,
           'ticktext': [PHASE_SHORT[PHASES[i]] for i in phases],
           'range': [-0.6, len(phases) - 0.4]},
    )  # fmt: skip
    return _finished(data, panel, version, view)


def binned_mean(x: FloatArray, y: FloatArray, width: float) -> dict[str, list[float | None]]:
    """Return the mean of y in bins of x; where a bin has fewer than five rows there is a gap."""
    if not len(x):
        return {'x': [], 'y': []}
    place = np.floor(x / width).astype(np.int64)
    first = int(place.min())
    count = np.bincount(place - first)
    total = np.bincount(place - first, y)
    mean: FloatArray = np.full(len(count), np.nan)
    np.divide(total, count, out=mean, where=count >= LEAST_BIN_ROWS)
    middles: FloatArray = width * (first + 0.5 + np.arange(len(count), dtype=np.float64))
    return {'x': rounded(middles), 'y': rounded(mean, 4)}


def _chosen(rows: _Rows, x: FloatArray, view: View) -> Sequence[dict[str, Any]]:
    """Return the blocks of the chosen place."""
    picked = np.flatnonzero(rows.good & rows.chosen)
    if not len(picked):
        return []
    return [{
        'type': 'scatter', 'mode': 'markers', 'name': str(view.place),
        'x': rounded(x[picked]), 'y': rounded(rows.residual[picked], 4),
        'marker': {'color': '@model', 'size': 4.5},
        'hovertemplate': f'{view.place}: %{{y:.3~g}} {rows.unit}<extra></extra>',
        **trace_axes(0),
    }]  # fmt: skip


def _explained(
    rows: _Rows, x: FloatArray, preview: EffectPreview | None
) -> Sequence[dict[str, Any]]:
    """Return what a candidate would explain of the blocks that are drawn."""
    if rows.explained is None or preview is None:
        return []
    picked = np.flatnonzero(rows.good & np.isfinite(rows.explained))
    picked = picked[:: max(1, len(picked) // MOST_DRAWN_POINTS)]
    name = f'{preview.effect.replace("_", " ")} would explain'
    return [{
        'type': 'scatter', 'mode': 'markers', 'name': name,
        'x': rounded(x[picked]), 'y': rounded(rows.explained[picked], 4),
        'marker': {'color': '@candidate', 'size': 3},
        'hovertemplate': f'{name}: %{{y:.3~g}} {rows.unit}<extra></extra>',
        **trace_axes(0),
    }]  # fmt: skip


def _finished(data: list[dict[str, Any]], panel: Panel, version: Version, view: View) -> Figure:
    floor = noise_band(version, view)
    band = {
        'type': 'rect', 'xref': 'x domain', 'yref': 'y', 'x0': 0, 'x1': 1, 'y0': -(floor or 0.0),
        'y1': floor, 'layer': 'below', 'line': {'width': 0}, 'fillcolor': '@noise',
    }  # fmt: skip
    data = [*data, cursor_trace(trace_axes(0))]
    spec = figure(data, [panel], height=230, shapes=[band] if floor else [])
    for part in (spec['layout'], spec['narrow']):
        part['margin'] = part['margin'] | {'t': 34}
    return spec
