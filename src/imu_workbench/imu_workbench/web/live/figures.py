# SPDX-License-Identifier: Apache-2.0
"""Figures of the live view as Plotly specifications; colours are tokens of the palette."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray
from thermal_comp.presentation.display import DISPLAY_UNITS, FILTER_LABELS

from imu_workbench.report.figures.palette import AXES
from imu_workbench.report.series import decimated
from imu_workbench.web.live.readings import (
    SENSOR_TRACKS,
    TEMPERATURE_TRACKS,
    euler_line,
    line,
    orientation_names,
    static_line,
)
from imu_workbench.web.live.state import LiveState

LINE_POINTS = 240
"""Points of a line on the screen, every extreme among them."""
TEMPERATURE_LOOK = {
    'temperature': ('die', '@temperature', 'solid'),
    'device': ('device', '@temperature', 'dashdot'),
    'air': ('air', '@temperature', 'dash'),
    'setpoint': ('set-point', '@soft', 'dot'),
}
"""Label, colour and dash of each temperature."""
FILTER_LOOK = {'complementary': '@d0', 'ahrs': '@d1'}
TIME_UNITS = ((120.0, 's', 1.0), (7200.0, 'min', 60.0), (float('inf'), 'h', 3600.0))
MIN_TIME_AXIS_S = 10.0
"""Shortest time axis [s]."""
DEGREES_PER_RADIAN = 180.0 / np.pi


def measured_figure(state: LiveState, sensor: str, window_s: float) -> dict[str, Any]:
    """Return raw and compensated values, one panel an axis."""
    tracks, unit = SENSOR_TRACKS[sensor], DISPLAY_UNITS[sensor]
    data = []
    for name, track in (('raw', tracks.raw), ('compensated', tracks.compensated)):
        lines = line(state, track, window_s, tracks.columns)
        for place, axis in enumerate(AXES):
            colour = '@raw_soft' if name == 'raw' else f'@{axis}'
            label = name if name == 'raw' else axis
            show = name != 'raw' or not place
            values = unit.of(lines.values[:, place])
            data.append(_trace(lines.time, values, label, colour, place, window_s, show=show))
    return _figure(data, [f'{axis} [{unit.unit}]' for axis in AXES], window_s)


def residual_figure(state: LiveState, sensor: str, window_s: float, zero: int) -> dict[str, Any]:
    """Return what compensation takes away, and what it leaves since the zero."""
    tracks, unit = SENSOR_TRACKS[sensor], DISPLAY_UNITS[sensor]
    taken = line(state, tracks.difference, window_s, tracks.columns)
    left = static_line(state, sensor, window_s, zero)
    data = [
        _trace(
            lines.time, unit.of(lines.values[:, i]), axis, f'@{axis}', panel, window_s,
            show=not panel,
        )
        for panel, lines in enumerate((taken, left))
        for i, axis in enumerate(AXES)
    ]  # fmt: skip
    titles = [f'raw − comp. [{unit.unit}]', f'static residual [{unit.unit}]']
    return _figure(data, titles, window_s)


def temperature_figure(state: LiveState, window_s: float) -> dict[str, Any]:
    """Return die, device, air and set-point."""
    data = []
    for name in TEMPERATURE_TRACKS:
        lines = line(state, name, window_s)
        if len(lines.time):
            label, colour, dash = TEMPERATURE_LOOK[name]
            data.append(
                _trace(lines.time, lines.values[:, 0], label, colour, 0, window_s, dash=dash)
            )
    return _figure(data, ['temperature [°C]'], window_s)


def euler_figure(state: LiveState, window_s: float) -> dict[str, Any]:
    """Return roll, pitch and yaw of both filters."""
    data = []
    for name in orientation_names(state):
        lines = euler_line(state, name, window_s)
        for panel in range(3):
            values = lines.values[:, panel] * DEGREES_PER_RADIAN
            data.append(
                _trace(
                    lines.time, values, FILTER_LABELS[name], FILTER_LOOK[name], panel, window_s,
                    show=not panel,
                )
            )  # fmt: skip
    return _figure(data, ['roll [°]', 'pitch [°]', 'yaw [°]'], window_s)


def _span(window_s: float) -> tuple[str, float]:
    """Return the unit of time a window is drawn in, and its seconds."""
    return next((unit, seconds) for limit, unit, seconds in TIME_UNITS if window_s <= limit)


def _trace(
    time: FloatArray,
    values: FloatArray,
    name: str,
    colour: str,
    panel: int,
    window_s: float,
    *,
    show: bool = True,
    dash: str = 'solid',
) -> dict[str, Any]:
    """Return one line in the panel-th panel."""
    known = np.isfinite(values)
    x, y = decimated(time[known], values[known], LINE_POINTS)
    _, seconds = _span(window_s)
    number = '' if panel == 0 else str(panel + 1)
    return {
        'type': 'scatter', 'mode': 'lines', 'name': name, 'legendgroup': name, 'showlegend': show,
        'x': np.round(x / seconds, 4).tolist(), 'y': [float(f'{value:.6g}') for value in y],
        'xaxis': 'x', 'yaxis': f'y{number}', 'line': {'color': colour, 'width': 1.3, 'dash': dash},
    }  # fmt: skip


def _shown_s(data: Sequence[dict[str, Any]], window_s: float, seconds: float) -> float:
    """Return how far back the time axis reaches: as far as there are data."""
    first = min((trace['x'][0] for trace in data if trace['x']), default=0.0)
    return min(window_s / seconds, max(-first, MIN_TIME_AXIS_S / seconds))


def _figure(
    data: Sequence[dict[str, Any]], titles: Sequence[str], window_s: float
) -> dict[str, Any]:
    """Return panels one below the other over the same time."""
    unit, seconds = _span(window_s)
    count = len(titles)
    height, gap = 1.0 / count, 0.07 / count
    soft = {'color': '@soft', 'size': 11}
    layout: dict[str, Any] = {
        'paper_bgcolor': '@panel', 'plot_bgcolor': '@panel',
        'font': {'color': '@text', 'size': 12, 'family': 'system-ui, sans-serif'},
        'margin': {'l': 66, 'r': 10, 't': 30, 'b': 40}, 'uirevision': f'{titles}{window_s}',
        'legend': {'orientation': 'h', 'x': 0, 'y': 1, 'yanchor': 'bottom',
                   'font': {'size': 11.5}, 'itemwidth': 30},
        'xaxis': {
            'title': {'text': f'time before now [{unit}]', 'font': soft, 'standoff': 4},
            'range': [-_shown_s(data, window_s, seconds), 0], 'gridcolor': '@grid',
            'linecolor': '@axis', 'zeroline': False, 'tickfont': soft,
            'anchor': f'y{count}' if count > 1 else 'y',
        },
    }  # fmt: skip
    for place, title in enumerate(titles):
        number = '' if place == 0 else str(place + 1)
        layout[f'yaxis{number}'] = {
            'title': {'text': title, 'font': soft, 'standoff': 4},
            'domain': [1 - (place + 1) * height + gap, 1 - place * height - gap],
            'gridcolor': '@grid', 'linecolor': '@axis', 'zerolinecolor': '@axis', 'tickfont': soft,
            'nticks': 5, 'exponentformat': 'power',
        }  # fmt: skip
    return {
        'data': list(data), 'layout': layout,
        'config': {'displaylogo': False, 'displayModeBar': False, 'responsive': True},
    }  # fmt: skip
