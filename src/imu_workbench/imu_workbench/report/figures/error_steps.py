# SPDX-License-Identifier: Apache-2.0
"""Bars of the error after each version of the model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from thermal_comp.presentation.display import shown

from imu_workbench.report.figures.attitude import FILTER_NAMES
from imu_workbench.report.figures.panels import Figure, Panel, figure, trace_axes


def error_steps_figure(parts: Mapping[str, Any]) -> Figure:
    """Return the error after each step per sensor or filter, with the noise floor.

    Proposals are hatched.
    """
    data: list[dict[str, Any]] = []
    panels, shapes = [], []
    for i, (name, found) in enumerate(parts.items()):
        unit = found['unit']
        for kind, label in (('steps', 'reached'), ('proposed', 'proposed')):
            bars = found[kind]
            if not bars:
                continue
            data.append({
                'type': 'bar', 'name': label, 'legendgroup': label,
                'showlegend': label not in {trace['name'] for trace in data},
                'x': [_wrapped(bar['label']) for bar in bars],
                'y': [bar['error'] for bar in bars],
                'text': [shown(bar['error']) for bar in bars], 'textposition': 'outside',
                'cliponaxis': False,
                'marker': {'color': '@model' if kind == 'steps' else '@raw_soft',
                           'pattern': {'shape': '' if kind == 'steps' else '/'}},
                'hovertemplate': f'%{{x}}: %{{y:.4~g}} {unit}<extra></extra>',
                **trace_axes(i),
            })  # fmt: skip
        if found['floor']:
            shapes.append(_floor_line(trace_axes(i), found['floor']))
        panels.append(
            Panel('', f'{"σ" if unit == "°" else "rms over the axes"} [{unit}]',
                  title=_title(name, found),
                  x={'tickangle': 0}, y=logarithmic_axis(_values(found)))
        )  # fmt: skip
    spec = figure(data, panels, columns=3, height=230, linked=False, shapes=shapes)
    spec['layout']['bargap'] = 0.35
    return spec


def _title(name: str, found: Mapping[str, Any]) -> str:
    if found['floor']:
        return f'{name.capitalize()}, floor {shown(found["floor"])} {found["unit"]}'
    return f'{FILTER_NAMES.get(name, name)}, σ of the rotation'


def _floor_line(place: Mapping[str, str], floor: float) -> dict[str, Any]:
    return {
        'type': 'line', 'xref': f'{place["xaxis"]} domain', 'yref': place['yaxis'],
        'x0': 0, 'x1': 1, 'y0': floor, 'y1': floor,
        'line': {'color': '@soft', 'dash': 'dash', 'width': 1.6},
    }  # fmt: skip


def logarithmic_axis(values: Sequence[float]) -> dict[str, Any]:
    """Return the axis around positive values: labels at every decade, at 2 and 5 where few."""
    known = [v for v in values if v > 0.0] or [1.0]
    low, high = math.log10(min(known) / 3.0), math.log10(max(known) * 3.0)
    return {'type': 'log', 'dtick': 'D2' if high - low < 2.5 else 1, 'range': [low, high]}


def _values(found: Mapping[str, Any]) -> list[float]:
    """Return the heights of all bars, and the floor."""
    bars = [bar['error'] for kind in ('steps', 'proposed') for bar in found[kind]]
    return [value for value in (*bars, found['floor']) if value]


def _wrapped(label: str) -> str:
    """Return a label of one word a line, '+' with its word."""
    return '<br>'.join(label.replace('+ ', '+\xa0').split(' '))
