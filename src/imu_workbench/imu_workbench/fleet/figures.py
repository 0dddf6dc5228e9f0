# SPDX-License-Identifier: Apache-2.0
"""Figures of the page of a fleet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from imu_workbench.fleet.statistics.vectors import Vectors
from imu_workbench.fleet.summary import campaign_text, shortest_first
from imu_workbench.report.figures.palette import AXES, device_colour
from imu_workbench.report.figures.panels import Figure, Panel, figure, trace_axes

MAP_DEVICES = 40
HISTOGRAM_BINS = 40
CHART_DEVICES = 400
"""Devices a control chart draws one by one; of more only every k-th and those beyond limits."""
HIGHEST_RATIO = 1.4
"""Where the scale of the shortening curve ends."""
LARGEST_LOG_PROBABILITY = 12.0
"""The map's scale ends here (−log10 of a probability)."""


def worst_devices(scores: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Return the devices of the map, worst first."""
    return sorted(scores, key=lambda device: -max(scores[device].values()))[:MAP_DEVICES]


def map_figure(
    scores: Mapping[str, Mapping[str, float]], sensors: Sequence[str], places: Mapping[str, str]
) -> Figure:
    """Return devices × sensors, worst first, as a heat map; names link to `places` (URLs)."""
    worst = worst_devices(scores)[::-1]
    z = [[min(LARGEST_LOG_PROBABILITY, scores[d].get(s, 0.0)) for s in sensors] for d in worst]
    trace = {
        'type': 'heatmap',
        'x': list(sensors),
        'y': worst,
        'z': z,
        'zmin': 0.0,
        'zmax': LARGEST_LOG_PROBABILITY,
        'xgap': 2,
        'ygap': 1,
        'colorscale': [[0.0, '@calm'], [0.4, '@raised'], [1.0, '@loud']],
        'colorbar': {
            'title': {'text': '−log₁₀ p', 'side': 'right'},
            'thickness': 12,
            'outlinewidth': 0,
        },
        'hovertemplate': '%{y} %{x}: %{z:.1f}<extra></extra>',
    } | trace_axes(0)
    category = {'type': 'category', 'showgrid': False}
    names = [f'<a href="{escape(places[d])}">{escape(d)}</a>' if d in places else d for d in worst]
    labels = {'tickmode': 'array', 'tickvals': worst, 'ticktext': names, 'tickfont': {'size': 10}}
    height = 60 + 15 * len(worst)
    spec = figure(
        [trace],
        [Panel('', '', x=category, y={**category, **labels})],
        height=height,
    )
    spec['layout']['margin']['l'] = 90
    return spec


def distribution_figure(sensors: Sequence[Vectors]) -> Figure:
    """Return the slopes of every axis (columns) and sensor (rows), a curve per lot."""
    data: list[dict[str, Any]] = []
    panels: list[Panel] = []
    lots = sorted({str(lot) for vectors in sensors for lot in vectors.lot})
    for vectors in sensors:
        for a, axis in enumerate(AXES):
            place = trace_axes(len(panels))
            values = vectors.coefficients[:, a]
            edges = np.histogram_bin_edges(_within(values), HISTOGRAM_BINS)
            for number, lot in enumerate(lots):
                count, _ = np.histogram(values[vectors.lot == lot], edges)
                data.append(
                    {
                        'type': 'scatter',
                        'x': (0.5 * (edges[1:] + edges[:-1])).tolist(),
                        'y': count.tolist(),
                        'mode': 'lines',
                        'name': f'lot {lot}',
                        'legendgroup': lot,
                        'showlegend': not panels,
                        'line': {'shape': 'hvh', 'width': 1.4, 'color': device_colour(number)},
                        'hovertemplate': f'lot {lot}: %{{y}} at %{{x:.3g}}<extra></extra>',
                    }
                    | place
                )
            title = f'{vectors.sensor} {axis}'
            few = {'nticks': 4, 'tickangle': 0}
            panels.append(Panel(f'[{vectors.unit}]', '' if a else 'devices', title, x=few))
    return figure(data, panels, columns=3, height=150, linked=False)


def _within(values: np.ndarray) -> np.ndarray:
    """Return the values without outliers so far off that lots would shrink to a line."""
    low, high = np.quantile(values, [0.25, 0.75])
    near = np.abs(values - 0.5 * (low + high)) < 4.0 * max(high - low, 1e-300)
    return np.asarray(values[near])


def control_figure(sensors: Sequence[Vectors], charts: Sequence[Mapping[str, Any]]) -> Figure:
    """Return individuals in the order of lots and time, with each lot's control limits."""
    data: list[dict[str, Any]] = []
    panels: list[Panel] = []
    for vectors in sensors:
        for axis in AXES:
            place = trace_axes(len(panels))
            own = [c for c in charts if (c['sensor'], c['axis']) == (vectors.sensor, axis)]
            data += _control_traces(vectors, axis, own, place, legend=not panels)
            title = f'{vectors.sensor} {axis}'
            first = axis == AXES[0]
            panels.append(Panel('device', f'[{vectors.unit}]' if first else '', title=title))
    return figure(data, panels, columns=3, height=160, linked=False)


def _control_traces(
    vectors: Vectors,
    axis: str,
    charts: Sequence[Mapping[str, Any]],
    place: Mapping[str, str],
    *,
    legend: bool,
) -> list[dict[str, Any]]:
    x: list[int] = []
    y: list[float] = []
    beyond: list[tuple[int, float]] = []
    limits: list[tuple[float | None, float | None]] = []
    start = 0
    for chart in charts:
        group = vectors.of((vectors.lot == chart['lot']) & (vectors.type == chart['type']))
        order = np.lexsort((group.device, group.measured_at))
        values = group.coefficients[order, AXES.index(axis)]
        odd = np.isin(group.device[order], chart['beyond'])
        step = max(1, len(vectors) // CHART_DEVICES)
        x += range(start, start + len(values), step)
        y += values[::step].tolist()
        beyond += [(start + int(i), float(values[i])) for i in np.flatnonzero(odd)]
        for level in (*chart['limits'], chart['centre']):
            limits += [(start, level), (start + len(values) - 1, level), (None, None)]
        start += len(values)
    points = {'type': 'scatter', 'mode': 'markers', 'hoverinfo': 'x+y', **place}
    return [
        {**points, 'x': x, 'y': y, 'name': 'device', 'legendgroup': 'device',
         'showlegend': legend, 'marker': {'size': 3, 'color': '@raw'}},
        {**points, 'mode': 'lines', 'x': [p[0] for p in limits], 'y': [p[1] for p in limits],
         'name': 'centre and control limits of a lot', 'legendgroup': 'limits',
         'showlegend': legend, 'line': {'width': 1, 'color': '@model'}},
        {**points, 'x': [p[0] for p in beyond], 'y': [p[1] for p in beyond],
         'name': 'beyond a limit', 'legendgroup': 'beyond', 'showlegend': legend,
         'marker': {'size': 6, 'color': '@y'}},
    ]  # fmt: skip


def shortening_figure(curve: Mapping[str, Any]) -> Figure:
    """Return the ratio to the full campaign over the hours, a panel a sensor.

    The lines join the campaigns than which no shorter one is better.
    """
    data: list[dict[str, Any]] = []
    panels: list[Panel] = []
    points = curve['points']
    most = max(point['hours'] for point in points)
    for sensor in dict.fromkeys(point['sensor'] for point in points):
        place = trace_axes(len(panels))
        for poses in sorted({point['poses'] for point in points}):
            own = [
                p for p in points if (p['sensor'], p['poses'], p['prior']) == (sensor, poses, True)
            ]
            data.append(_campaigns(own, poses, place, legend=not panels))
        for prior, dash in ((True, 'solid'), (False, 'dot')):
            best = shortest_first(points, sensor, prior=prior)
            data.append(
                {
                    'type': 'scatter', 'mode': 'lines', **place,
                    'x': [p['hours'] for p in best], 'y': [p['ratio'] for p in best],
                    'name': 'the best, lot known' if prior else 'the best, lot unknown',
                    'legendgroup': f'best{prior}', 'showlegend': not panels,
                    'line': {'color': '@raw', 'width': 1.5, 'dash': dash}, 'hoverinfo': 'skip',
                }
            )  # fmt: skip
        data.append(
            {'type': 'scatter', 'mode': 'lines', **place, 'x': [0.0, most],
             'y': [curve['good_enough']] * 2, 'name': f'{curve["good_enough"]:g} × full campaign',
             'legendgroup': 'bound', 'showlegend': False,
             'line': {'color': '@model', 'width': 1, 'dash': 'dash'}}
        )  # fmt: skip
        label = 'error over that of the full campaign' if not panels else ''
        panels.append(Panel('hours', label, title=sensor, y={'range': [0.97, HIGHEST_RATIO]}))
    return figure(data, panels, columns=3, height=280, linked=False)


def _campaigns(
    own: Sequence[Mapping[str, Any]], poses: int, place: Mapping[str, str], *, legend: bool
) -> dict[str, Any]:
    """Return the short campaigns of one sensor in so many poses, the lot known."""
    ranges = np.array([p['ratio_range'] for p in own]).reshape(-1, 2)
    ratio = np.array([p['ratio'] for p in own])
    return {
        'type': 'scatter', 'mode': 'markers', **place,
        'x': [p['hours'] for p in own],
        'y': ratio.tolist(),
        'error_y': {
            'type': 'data', 'symmetric': False, 'thickness': 1, 'width': 3,
            'array': (ranges[:, 1] - ratio).tolist(),
            'arrayminus': (ratio - ranges[:, 0]).tolist(),
        },
        'text': [campaign_text(p) for p in own],
        'name': f'{poses} pose{"s"[: poses > 1]}, lot known',
        'legendgroup': f'{poses}',
        'showlegend': legend,
        'marker': {'color': device_colour(poses - 1), 'size': 6},
        'hovertemplate': '%{text}: %{y:.3f}<extra></extra>',
    }  # fmt: skip
