# SPDX-License-Identifier: Apache-2.0
"""The error staircase: how far each version of the model brings the held-out error down."""

from __future__ import annotations

from collections.abc import Sequence

from imu_workbench.display import DISPLAY_UNITS, SENSORS, shown
from imu_workbench.report.panels import Figure, Panel, figure, trace_axes
from imu_workbench.web.version import Version


def staircase_figure(versions: Sequence[Version], current: int) -> Figure:
    """Return error over version, a panel per sensor; the floor is a dashed line."""
    sensors = [s for s in SENSORS if s in versions[0].comparison['sensors']]
    names = ['none', *(f'v{i + 1}' for i in range(len(versions)))]
    data, panels, shapes = [], [], []
    for i, sensor in enumerate(sensors):
        unit, factor = DISPLAY_UNITS[sensor].unit, DISPLAY_UNITS[sensor].factor
        errors = [versions[0].measured(sensor), *(v.error(sensor) for v in versions)]
        values = [value * factor for value in errors]
        floor = versions[current].floor(sensor) * factor
        labels = ['no model', *(version.label for version in versions)]
        data.append({
            'type': 'scatter', 'mode': 'lines+markers+text', 'showlegend': False,
            'name': sensor, 'x': names, 'y': [float(f'{v:.5g}') for v in values],
            'line': {'shape': 'hvh', 'color': '@compensated', 'width': 2},
            'marker': {'size': [13 if k == current + 1 else 8 for k in range(len(values))],
                       'color': '@compensated'},
            'text': [shown(v) for v in values], 'textposition': 'top center',
            'textfont': {'size': 11}, 'cliponaxis': False, 'customdata': labels,
            'hovertemplate': f'%{{customdata}}: %{{y:.3~g}} {unit}<extra></extra>',
            **trace_axes(i),
        })  # fmt: skip
        place = trace_axes(i)
        shapes.append({
            'type': 'line', 'xref': f'{place["xaxis"]} domain', 'yref': place['yaxis'],
            'x0': 0, 'x1': 1, 'y0': floor, 'y1': floor,
            'line': {'color': '@z', 'dash': 'dash', 'width': 1.6},
        })  # fmt: skip
        panels.append(
            Panel('model', f'held-out rms [{unit}]' if i == 0 else f'[{unit}]',
                  title=f'{sensor.capitalize()} (floor {shown(floor)})',
                  x={'type': 'category', 'range': [-0.5, len(names) - 0.5], 'showgrid': False},
                  y={'type': 'log', 'dtick': 1, 'range': _decades([*values, floor])})
        )  # fmt: skip
    spec = figure(data, panels, columns=3, height=210, linked=False, shapes=shapes)
    spec['layout']['margin']['t'] = spec['narrow']['margin']['t'] = 30
    spec['layout']['height'] -= 20
    return spec


def _decades(values: Sequence[float]) -> list[float]:
    from math import log10

    known = [v for v in values if v > 0.0] or [1.0]
    return [log10(min(known) / 2.5), log10(max(known) * 3.0)]
