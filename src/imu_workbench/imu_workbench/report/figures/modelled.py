# SPDX-License-Identifier: Apache-2.0
"""Figures of model against measurement: dependence, fit, distributions, residual, where it fails.

Figures 5 and 6 of the paper, and what its linear model leaves over time and over averaging time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from thermal_comp.presentation.display import DISPLAY_UNITS, shown

from imu_workbench.report.figures.error_steps import logarithmic_axis
from imu_workbench.report.figures.measured import PHASE_NAMES, curve
from imu_workbench.report.figures.palette import AXES, device_colour
from imu_workbench.report.figures.panels import TOOLBAR_PX, Figure, Panel, figure, trace_axes

LARGEST_SHOWN_RATIO = 10.0
"""Ratio to the noise floor from which the colour of a heat map changes no more."""
FAILURE_COLOUR_SCALE: dict[str, Any] = {
    'cmin': 0.0,
    'cmax': math.log10(LARGEST_SHOWN_RATIO),
    'colorscale': [[0.0, '@calm'], [0.11, '@calm'], [0.5, '@raised'], [1.0, '@loud']],
    'colorbar': {
        'title': {'text': 'times the noise floor', 'side': 'right'},
        'thickness': 12, 'outlinewidth': 0,
        'tickvals': [0.0, math.log10(2.0), math.log10(5.0), 1.0],
        'ticktext': ['1', '2', '5', '≥ 10'],
    },
}  # fmt: skip
"""The logarithm of residual over noise floor as a colour."""
TEXT_COLOURS = ((0.5, '@on_calm'), (0.78, '@on_raised'), (math.inf, '@on_loud'))
"""Logarithm of the ratio up to which a cell's number has a colour that contrasts with the cell."""
PART_COLOURS = {'cold dwell': '@cold', 'hot dwell': '@hot', 'other': '@raw_soft'}


def dependence_figure(by_device: Mapping[str, Mapping[str, Any]], unit: str) -> Figure:
    """Return error against die temperature of every device, a panel per axis (Fig. 5)."""
    data: list[dict[str, Any]] = []
    for number, (device, found) in enumerate(by_device.items()):
        colour = device_colour(number)
        for i, axis in enumerate(AXES):
            column = found['axes'][axis]
            data.append({
                'type': 'scatter', 'mode': 'markers', 'name': device, 'legendgroup': device,
                'showlegend': i == 0, 'x': found['temperature'], 'y': column['measured'],
                'error_y': {'array': column['spread'], 'thickness': 1, 'width': 0,
                            'color': colour},
                'marker': {'color': colour, 'size': 5},
                'hovertemplate': f'{device} {axis}: %{{y:.4~g}} ± %{{error_y.array:.2~g}} {unit} '
                                 'at %{x:.1f} °C<extra></extra>',
                **trace_axes(i),
            })  # fmt: skip
            series = {'x': found['temperature'], 'y': column['modelled']}
            data.append(
                curve(series, f'{device} model', trace_axes(i), color=colour, width=2,
                      legendgroup=device, showlegend=False, hoverinfo='skip')
            )  # fmt: skip
    panels = [
        Panel('die temperature [°C]', f'error [{unit}]' if i == 0 else '', title=f'axis {axis}')
        for i, axis in enumerate(AXES)
    ]
    return figure(data, panels, columns=3, height=270)


def fit_figure(fit: Mapping[str, Any], unit: str, floor: float | None) -> Figure:
    """Return the scatter with the model, and the distribution before and after (Fig. 6)."""
    data: list[dict[str, Any]] = []
    for name, series in fit['points'].items():
        data.append({
            'type': 'scatter', 'mode': 'markers', 'name': name, **series,
            'marker': {'size': 3.5, 'opacity': 0.65,
                       'symbol': 'circle' if name == 'heating' else 'triangle-down',
                       'color': '@hot' if name == 'heating' else '@cold'},
            'hovertemplate': f'{name}: %{{y:.4~g}} {unit} at %{{x:.2f}} °C<extra></extra>',
            **trace_axes(0),
        })  # fmt: skip
    data.append(
        curve(fit['model'], 'model', trace_axes(0), color='@model', width=2, hoverinfo='skip')
    )
    for i, key in enumerate(('before', 'after'), 1):
        found = fit[key]
        for part, counts in found['counts'].items():
            data.append({
                'type': 'bar', 'name': part, 'legendgroup': part, 'showlegend': i == 1,
                'x': found['centre'], 'y': counts, 'marker': {'color': PART_COLOURS[part]},
                'hovertemplate': f'{part}: %{{y}} blocks at %{{x:.3~g}} {unit}<extra></extra>',
                **trace_axes(i),
            })  # fmt: skip
        data.append(
            curve({'x': found['centre'], 'y': found['normal']}, 'normal distribution',
                  trace_axes(i), color='@model', width=1.6, dash='dot', legendgroup='normal',
                  showlegend=i == 1, hoverinfo='skip')
        )  # fmt: skip
    noise = f' (noise floor σ {floor:.2g} {unit})' if floor else ''
    panels = [
        Panel('die temperature [°C]', f'error [{unit}]', title='measured and model'),
        Panel(f'error [{unit}]', 'blocks of 20 s', title='before compensation'),
        Panel(f'residual [{unit}]', 'blocks of 20 s', title=f'after{noise}'),
    ]
    return figure(data, panels, columns=3, height=270, linked=False, barmode='stack')


def residual_figure(axes: Mapping[str, Any], unit: str, floor: list[float] | None) -> Figure:
    """Return measured, modelled and residual error over time, axis by axis."""
    data: list[dict[str, Any]] = []
    panels, shapes = [], []
    for i, axis in enumerate(AXES):
        above, below = trace_axes(2 * i), trace_axes(2 * i + 1)
        hover = f'%{{y:.4~g}} {unit} at %{{x:.2f}} h<extra></extra>'
        data += [
            curve(axes[axis]['measured'], 'measured', above, color='@raw_soft', width=3,
                  showlegend=i == 0, legendgroup='measured', hovertemplate='measured ' + hover),
            curve(axes[axis]['modelled'], 'modelled', above, color='@model', width=1.3,
                  showlegend=i == 0, legendgroup='modelled', hovertemplate='modelled ' + hover),
            curve(axes[axis]['residual'], 'residual', below, color=f'@{axis}', width=1,
                  showlegend=False, hovertemplate='residual ' + hover),
        ]  # fmt: skip
        panels += [
            Panel('time [h]', f'error [{unit}]', title=f'axis {axis}'),
            Panel('time [h]', f'residual [{unit}]', y={'nticks': 4}),
        ]
        if floor and floor[i]:
            place = trace_axes(2 * i + 1)
            shapes.append({
                'type': 'rect', 'xref': f'{place["xaxis"]} domain', 'yref': place['yaxis'],
                'x0': 0, 'x1': 1, 'y0': -2 * floor[i], 'y1': 2 * floor[i], 'layer': 'below',
                'line': {'width': 0}, 'fillcolor': '@noise',
            })  # fmt: skip
    return figure(data, panels, columns=1, height=118, shapes=shapes)


def allan_deviation_figure(curves: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Return deviation over averaging time, a panel per sensor; a band is the 95 % interval."""
    data: list[dict[str, Any]] = []
    panels = []
    for i, (sensor, found) in enumerate(curves.items()):
        unit = DISPLAY_UNITS[sensor].unit
        for axis, line in found.items():
            place = trace_axes(i)
            data.append({
                'type': 'scatter', 'mode': 'lines', 'name': axis, 'legendgroup': axis,
                'showlegend': False, 'hoverinfo': 'skip', 'line': {'width': 0},
                'x': [*line['tau'], *reversed(line['tau'])],
                'y': [*line['low'], *reversed(line['high'])],
                'fill': 'toself', 'fillcolor': f'@{axis}_soft', 'opacity': 0.5, **place,
            })  # fmt: skip
            data.append(
                curve({'x': line['tau'], 'y': line['deviation']}, axis, place, color=f'@{axis}',
                      width=1.8, legendgroup=axis, showlegend=i == 0,
                      hovertemplate=f'{axis}: %{{y:.3~g}} {unit} at %{{x:.3~g}} s<extra></extra>')
            )  # fmt: skip
        panels.append(
            Panel('averaging time [s]', '', title=f'{sensor.capitalize()} [{unit}]',
                  x={'type': 'log', 'dtick': 1},
                  y=logarithmic_axis([v for line in found.values() for v in line['deviation']]))
        )  # fmt: skip
    return figure(data, panels, columns=3, height=240, linked=False)


def failure_figure(maps: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Return heat maps of residual by noise floor, by phase and cycle, each below its title.

    The colour of a cell goes from `calm` at the noise floor to `loud` at LARGEST_SHOWN_RATIO times
    it, in every figure alike, so that maps can be compared. On a phone the colour bar is left out.
    """
    traces = [failure_trace(where, i) for i, where in enumerate(maps.values())]
    panels = [failure_panel(title) for title in maps]
    for panel in panels[1:]:
        panel.y['showticklabels'] = False  # the rows are those of the first map
    rows = len(next(iter(maps.values()))['phases'])
    spec = figure(
        [*traces, *(cell_numbers(trace, trace['text']) for trace in traces)], panels,
        columns=len(maps), height=60 + 36 * rows, linked=False, coloraxis=FAILURE_COLOUR_SCALE,
    )  # fmt: skip
    spec['narrow']['coloraxis'] = {'showscale': False}
    for i in range(len(maps)):
        place = trace_axes(i)
        spec['narrow'][place['xaxis'].replace('x', 'xaxis')] |= {'tickangle': 0}
        spec['narrow'][place['yaxis'].replace('y', 'yaxis')] |= {'showticklabels': True}
    if not any(maps):
        spec['layout']['margin']['t'] = TOOLBAR_PX
        spec['narrow']['margin']['t'] = 12  # a phone shows no toolbar
    return spec


def cell_numbers(trace: Mapping[str, Any], texts: Sequence[Sequence[str]]) -> dict[str, Any]:
    """Return texts for the cells of a heat map as a trace over it, in colours that contrast."""
    cells = [
        (x, y, text, next(colour for most, colour in TEXT_COLOURS if value < most))
        for y, values, row in zip(trace['y'], trace['z'], texts, strict=True)
        for x, value, text in zip(trace['x'], values, row, strict=True)
        if value is not None
    ]
    x, y, labels, colours = (
        (list(column) for column in zip(*cells, strict=True)) if cells else ([],) * 4
    )
    return {
        'type': 'scatter', 'mode': 'text', 'name': 'numbers', 'showlegend': False,
        'x': x, 'y': y, 'customdata': labels, 'texttemplate': '%{customdata}',
        'textfont': {'size': 10, 'color': colours}, 'hoverinfo': 'skip',
        'xaxis': trace['xaxis'], 'yaxis': trace['yaxis'],
    }  # fmt: skip


def failure_panel(title: str) -> Panel:
    """Return the panel a heat map stands in."""
    return Panel('', '', title, y={'autorange': 'reversed', 'automargin': True}, x={'ticks': ''})


def failure_trace(where: Mapping[str, Any], index: int) -> dict[str, Any]:
    """Return a heat map in the index-th panel, coloured by FAILURE_COLOUR_SCALE."""
    colours = [
        [None if v is None else math.log10(min(max(v, 1.0), LARGEST_SHOWN_RATIO)) for v in row]
        for row in where['ratio']
    ]
    return {
        'type': 'heatmap',
        'x': [f'cycle {number}' for number in where['cycles']],
        'y': [PHASE_NAMES[name] for name in where['phases']],
        'z': colours,
        'customdata': where['ratio'],
        'text': [['' if v is None else f'{shown(v, 2)} ×' for v in row] for row in where['ratio']],
        'coloraxis': 'coloraxis',
        'xgap': 2,
        'ygap': 2,
        'hovertemplate': '%{y}, %{x}: %{customdata:.3~g} times the noise floor<extra></extra>',
        **trace_axes(index),
    }
