# SPDX-License-Identifier: Apache-2.0
"""Figures 7 and 8: attitude of a resting device by both filters, raw and compensated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from imu_workbench.report.figures.measured import curve
from imu_workbench.report.figures.panels import Figure, Panel, figure, trace_axes

ANGLE_TITLES = {'yaw': 'α (yaw)', 'pitch': 'β (pitch)', 'roll': 'γ (roll)'}
FILTER_NAMES = {'complementary': 'Complementary filter', 'ahrs': 'AHRS (Kalman)'}
DATA_LOOK = {
    'raw': {'color': '@raw', 'width': 1.1},
    'compensated': {'color': '@model', 'width': 1.5},
}


def attitude_figure(series: Mapping[str, Any], shown_data: Sequence[str]) -> Figure:
    """Return the three Euler angles (rows) by filter (columns) for the data that is asked for."""
    data: list[dict[str, Any]] = []
    panels = []
    for row, (angle, label) in enumerate(ANGLE_TITLES.items()):
        for column, name in enumerate(series):
            index = row * len(series) + column
            data += [
                curve(series[name][kind][angle], kind, trace_axes(index), **DATA_LOOK[kind],
                      legendgroup=kind, showlegend=index == 0,
                      hovertemplate=f'{label} {kind} %{{y:.2f}}° at %{{x:.2f}} h<extra></extra>')
                for kind in shown_data
            ]  # fmt: skip
            title = FILTER_NAMES.get(name, name)
            below = 'time [h]' if row == len(ANGLE_TITLES) - 1 else ''
            panels.append(Panel(below, f'{label} [°]', title=title))
    return figure(data, panels, columns=len(series), height=150)
