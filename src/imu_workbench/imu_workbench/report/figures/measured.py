# SPDX-License-Identifier: Apache-2.0
"""Figures of what was measured: the plan (Fig. 1) and one cycle (Fig. 4)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from imu_workbench.report.figures.palette import AXES
from imu_workbench.report.figures.panels import Figure, Panel, figure, trace_axes

TRACK_LOOK: dict[str, dict[str, Any]] = {
    'set-point': {'color': '@soft', 'dash': 'dot', 'width': 1.4},
    'chamber air': {'color': '@temperature', 'dash': 'dash', 'width': 1.1},
    'thermocouple on the device': {'color': '@temperature', 'dash': 'dashdot', 'width': 1.4},
    'die': {'color': '@temperature', 'width': 1.7},
}
TRACE_KEYS = ('showlegend', 'legendgroup', 'opacity', 'hoverinfo', 'hovertemplate')
"""What `curve` takes for the trace; everything else is the line's."""
LEAST_MARK_WIDTH = 0.04
"""Share of the figure's width that a label above the plan needs."""
PHASE_NAMES = {
    'precondition': 'preconditioning (reference)',
    'ramp_down': 'ramp down',
    'dwell_cold': 'cold dwell',
    'ramp_up': 'ramp up',
    'dwell_hot': 'hot dwell',
    'dwell_reference': 'dwell at ambient',
    'final': 'final measurement',
}


def curve(
    series: Mapping[str, Any], name: str, place: Mapping[str, str], **look: Any
) -> dict[str, Any]:
    """Return a line trace; `look` is the line's, but for TRACE_KEYS."""
    own: dict[str, Any] = {key: look.pop(key) for key in TRACE_KEYS if key in look}
    return {
        'type': 'scatter',
        'mode': 'lines',
        'name': name,
        'x': series['x'],
        'y': series['y'],
        'line': look,
        'connectgaps': False,
        **own,
        **place,
    }


def plan_figure(plan: Mapping[str, Any]) -> Figure:
    """Return set-point, air, thermocouple and die over the run (Fig. 1)."""
    data = [
        curve(
            series,
            label,
            trace_axes(0),
            **TRACK_LOOK[label],
            hovertemplate=f'{label} %{{y:.2f}} °C at %{{x:.2f}} h<extra></extra>',
        )
        for label, series in plan['tracks'].items()
    ]
    bands = [
        {
            'type': 'rect', 'xref': 'x', 'yref': 'paper', 'y0': 0, 'y1': 1, 'layer': 'below',
            'x0': leg['from_h'], 'x1': leg['to_h'], 'line': {'width': 0}, 'fillcolor': '@band',
        }
        for leg in plan['phases']
        if leg['phase'].startswith('dwell')
    ]  # fmt: skip
    marks = [
        {
            'text': text, 'x': x, 'y': 1, 'xref': 'x', 'yref': 'paper', 'yanchor': 'bottom',
            'xanchor': 'left', 'showarrow': False, 'font': {'size': 11, 'color': '@soft'},
        }
        for text, x in _leg_marks(plan['phases'])
    ]  # fmt: skip
    panel = Panel('time since start [h]', 'temperature [°C]')
    return figure(data, [panel], height=300, shapes=bands, annotations=marks)


def _leg_marks(phases: list[dict[str, Any]]) -> list[tuple[str, float]]:
    """Return a label and its hour for every new part of the run that has room for one."""
    marks: list[tuple[str, float]] = []
    room = LEAST_MARK_WIDTH * max((leg['to_h'] for leg in phases), default=0.0)
    latest = ''
    for leg in phases:
        names = {'precondition': 'Ref.', 'final': 'Final'}
        text = names.get(leg['phase'], f'R{leg["cycle"]}')
        if text != latest and (not marks or leg['from_h'] - marks[-1][1] >= room):
            marks.append((text, leg['from_h']))
        latest = text
    return marks


def cycle_figure(cycle: Mapping[str, Any]) -> Figure:
    """Return one cycle of the three sensors as deviation from its mean (Fig. 4)."""
    data: list[dict[str, Any]] = []
    panels = []
    for i, (sensor, part) in enumerate(cycle['sensors'].items()):
        unit, first = part['unit'], i == 0
        data += [
            curve(part['axes'][axis], axis, trace_axes(i), color=f'@{axis}_soft', width=0.8,
                  showlegend=False, legendgroup=axis, hoverinfo='skip')
            for axis in AXES
        ]  # fmt: skip
        data += [
            curve(part['means_20_s'][axis], axis, trace_axes(i), color=f'@{axis}', width=1.8,
                  legendgroup=axis, showlegend=first,
                  hovertemplate=f'{axis} %{{y:.4~g}} {unit} at %{{x:.1f}} min<extra></extra>')
            for axis in AXES
        ]  # fmt: skip
        data.append(
            curve(cycle['temperature'], 'die temperature', trace_axes(i, right=True),
                  color='@temperature', width=1.4, dash='dash', legendgroup='temperature',
                  showlegend=first, hovertemplate='die %{y:.2f} °C<extra></extra>')
        )  # fmt: skip
        panels.append(
            Panel('time in the cycle [min]', f'Δ [{unit}]', title=sensor.capitalize(),
                  right_title='die [°C]')
        )  # fmt: skip
    return figure(data, panels, height=200)
