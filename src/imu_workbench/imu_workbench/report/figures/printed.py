# SPDX-License-Identifier: Apache-2.0
"""Pictures for paper: a run with what the certified model leaves, and its Allan deviation."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from thermal_comp.presentation.display import DISPLAY_UNITS

from imu_workbench.report.figures.measured import TRACK_LOOK
from imu_workbench.report.figures.palette import COLOURS

RUN_SIZE_INCHES = (7.1, 7.6)
ALLAN_SIZE_INCHES = (7.1, 2.3)
MATPLOTLIB_STYLE: Any = {
    'svg.fonttype': 'none',
    'font.size': 7.5,
    'font.family': 'DejaVu Sans',
    'svg.hashsalt': '',
}
LIGHT_COLOURS = COLOURS['light']
LINE_STYLES = {None: '-', 'dash': '--', 'dot': ':', 'dashdot': '-.'}
"""Plotly's dash → matplotlib's."""


def run_picture(plan: Mapping[str, Any] | None, residuals: Mapping[str, Any]) -> str:
    """Return SVG of one run: its temperatures above the residual of each sensor.

    `plan` is that of a recording's content, `residuals` those of the run in a certificate.
    """
    with rc_context(MATPLOTLIB_STYLE):
        figure = Figure(figsize=RUN_SIZE_INCHES, layout='constrained')
        panels = figure.subplots(1 + len(residuals), 1, sharex=True, squeeze=False)[:, 0]
        for label, track in (plan or {'tracks': {}})['tracks'].items():
            look = TRACK_LOOK[label]
            panels[0].plot(
                _numbers(track['x']), _numbers(track['y']), linewidth=0.8, label=label,
                color=LIGHT_COLOURS[look['color'].removeprefix('@')],
                linestyle=LINE_STYLES[look.get('dash')],
            )  # fmt: skip
        panels[0].set_ylabel('temperature [°C]')
        for panel, (sensor, found) in zip(panels[1:], residuals.items(), strict=True):
            for axis, line in found['axes'].items():
                panel.plot(
                    _numbers(line['x']), _numbers(line['y']), linewidth=0.6, label=axis,
                    color=LIGHT_COLOURS[axis],
                )  # fmt: skip
            floor = max(found['floor'])
            panel.axhspan(
                -2.0 * floor, 2.0 * floor, color='0.88', zorder=0, label='± 2 σ of noise'
            )
            panel.set_ylabel(f'{sensor} residual [{found["unit"]}]')
        for panel in panels:
            panel.grid(visible=True, color='0.92', linewidth=0.5)
            if panel.get_legend_handles_labels()[0]:
                panel.legend(
                    loc='lower right', bbox_to_anchor=(1.0, 0.97), ncols=4, frameon=False,
                    fontsize=6.5,
                )  # fmt: skip
        panels[-1].set_xlabel('time [h]')
        return _svg(figure)


def allan_picture(curves: Mapping[str, Mapping[str, Any]]) -> str:
    """Return SVG of the Allan deviation in a certificate, a panel per sensor."""
    with rc_context(MATPLOTLIB_STYLE):
        figure = Figure(figsize=ALLAN_SIZE_INCHES, layout='constrained')
        panels = figure.subplots(1, len(curves), squeeze=False)[0]
        for panel, (sensor, found) in zip(panels, curves.items(), strict=True):
            for axis, line in found.items():
                tau, low, high = (_numbers(line[key]) for key in ('tau', 'low', 'high'))
                panel.fill_between(
                    tau, low, high, color=LIGHT_COLOURS[f'{axis}_soft'], alpha=0.5, lw=0
                )
                panel.loglog(
                    tau,
                    _numbers(line['deviation']),
                    linewidth=0.9,
                    color=LIGHT_COLOURS[axis],
                    label=axis,
                )
            panel.set_title(f'{sensor.capitalize()} [{DISPLAY_UNITS[sensor].unit}]', fontsize=7.5)
            panel.set_xlabel('averaging time [s]')
            panel.grid(visible=True, color='0.92', linewidth=0.5)
            panel.legend(frameon=False, fontsize=6.5)
        return _svg(figure)


def _svg(figure: Figure) -> str:
    text = io.StringIO()
    figure.savefig(text, format='svg', metadata={'Date': None}, transparent=True)
    return text.getvalue()


def _numbers(values: Any) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
