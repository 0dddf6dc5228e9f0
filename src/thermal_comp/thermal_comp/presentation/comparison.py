# SPDX-License-Identifier: Apache-2.0
"""A comparison of model and measurement as text, table and picture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS, scaled, shown
from thermal_comp.presentation.html_table import html_table

if TYPE_CHECKING:
    from thermal_comp.presentation.picture import Picture

AXIS_COLOURS = {'x': '#c1440e', 'y': '#1a7f37', 'z': '#1f5fbf'}
"""Colours of the axes: equally light, and distinguishable without seeing red or green."""
COLUMN_TITLES = {
    'measured_rms': 'measured',
    'residual_rms': 'residual',
    'held_out_rms': 'held out',
    'noise_floor': 'floor',
}
"""Columns of the table: key of an error and its heading."""


def comparison_text(found: Mapping[str, Any]) -> str:
    """Return the comparison (the dictionary that --json writes) as a table."""
    head = ''.join(f'{label:>11}' for label in COLUMN_TITLES.values())
    name = found.get('device') or 'device'
    title = f'{name}, rms of {found["period"]:g} s means'
    lines = [f'{title:<30}{head}  unit   worst phase']
    for sensor in (s for s in SENSORS if s in found['sensors']):
        part, unit = found['sensors'][sensor], DISPLAY_UNITS[sensor]
        for i, axis in enumerate('xyz'):
            values = [part[key][i] for key in COLUMN_TITLES]
            numbers = ''.join(f'{shown(scaled(value, unit.factor)):>11}' for value in values)
            place = (part['worst_phase'] or '').replace('_', ' ')
            lines.append(f'  {sensor:<26}{axis:<2}{numbers}  {unit.unit:<6} {place}')
    return '\n'.join(lines)


text = comparison_text


def table(found: Mapping[str, Any]) -> str:
    """Return the comparison as an HTML table."""
    head = ['sensor', 'axis', *COLUMN_TITLES.values(), 'unit', 'worst phase']
    rows = []
    for sensor in (s for s in SENSORS if s in found['sensors']):
        part, unit = found['sensors'][sensor], DISPLAY_UNITS[sensor]
        place = (part['worst_phase'] or '').replace('_', ' ')
        for i, axis in enumerate('xyz'):
            values = [shown(scaled(part[key][i], unit.factor)) for key in COLUMN_TITLES]
            rows.append([sensor, axis, *values, unit.unit, place])
    title = f'{found.get("device") or "device"}, rms of {found["period"]:g} s means'
    return html_table(title, head, rows, found['notes'])


def picture(found: Any) -> Picture:
    """Return measured, residual and held-out error beside the noise floor, a panel a sensor."""
    from thermal_comp.presentation.picture import new_picture

    content = found.to_dict()
    sensors = [s for s in SENSORS if s in content['sensors']]
    figure, panels = new_picture(len(sensors))
    for panel, sensor in zip(panels, sensors, strict=True):
        part, unit = content['sensors'][sensor], DISPLAY_UNITS[sensor]
        for place, (key, label) in enumerate(COLUMN_TITLES.items()):
            values = [scaled(value, unit.factor) or float('nan') for value in part[key]]
            offset = 0.2 * (place - 1.5)
            panel.bar([i + offset for i in range(3)], values, 0.18, label=label)
        panel.set(title=sensor, yscale='log', ylabel=f'rms [{unit.unit}]')
        panel.set_xticks(range(3), 'xyz')
    panels[0].legend(fontsize='small')
    return figure


def residual_picture(found: Any) -> Picture:
    """Return the residual over time, a panel a sensor and a line an axis, runs one after another.

    The shaded band is twice the noise floor of the axis that has most. The background is white,
    so that the picture can be read on a dark page too.
    """
    import numpy as np

    from thermal_comp.presentation.picture import new_picture

    sensors = [s for s in SENSORS if s in found.sensors]
    figure, panels = new_picture(len(sensors), 2.4, stacked=True)
    figure.set_facecolor('white')
    starts = np.cumsum([0.0, *(time[-1] + found.period for time in found.times)])
    for panel, sensor in zip(panels, sensors, strict=True):
        part, unit = found.sensors[sensor], DISPLAY_UNITS[sensor]
        for number, (start, time) in enumerate(zip(starts, found.times, strict=False)):
            hours = (start + time) / 3600.0
            left = unit.factor * part.residuals[number]
            for axis, (label, colour) in enumerate(AXIS_COLOURS.items()):
                named = label if number == 0 else None
                panel.plot(hours, left[:, axis], color=colour, lw=0.8, label=named)
            if number:
                panel.axvline(start / 3600.0, color='0.4', lw=0.8, ls=':')
        band = 2.0 * unit.factor * float(np.max(part.noise_floor))
        panel.axhspan(-band, band, color='0.5', alpha=0.2, lw=0)
        panel.set(title=sensor, ylabel=f'residual [{unit.unit}]')
        panel.margins(x=0.01)
    panels[0].legend(fontsize='small', ncols=3, loc='upper right')
    panels[-1].set_xlabel('time, runs one after another [h]')
    return figure
