# SPDX-License-Identifier: Apache-2.0
"""Allan deviation of what the certified model leaves, with its confidence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from thermal_comp.presentation.display import DISPLAY_UNITS

from imu_workbench.report.figures.error_steps import logarithmic_axis
from imu_workbench.report.figures.measured import curve
from imu_workbench.report.figures.panels import Figure, Panel, figure, trace_axes


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
