# SPDX-License-Identifier: Apache-2.0
"""A second opinion as a picture: what was measured over temperature, and the autopilot's curve."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from thermal_comp.data.conditions import Sensor
from thermal_comp.presentation.comparison import AXIS_COLOURS

if TYPE_CHECKING:
    from thermal_comp.presentation.picture import Picture
    from thermal_comp.second_opinion.opinion import SecondOpinion


def opinion_picture(
    opinions: Sequence[tuple[str, SecondOpinion]], units: Mapping[Sensor, tuple[float, str]]
) -> Picture:
    """Return a panel for each IMU and sensor: block means as dots, the curve as a line.

    The shaded band is as wide to either side as the error that cooling may leave at most.
    `units`: factor from SI and unit of each sensor.
    """
    from thermal_comp.presentation.picture import new_picture

    panels_of = [(name, o, sensor) for name, o in opinions for sensor in o.sensors]
    figure, panels = new_picture(len(panels_of), 3.0, stacked=True)
    figure.set_facecolor('white')
    for panel, (name, opinion, sensor) in zip(panels, panels_of, strict=True):
        part, (factor, unit) = opinion.sensors[sensor], units[sensor]
        run = opinion.run
        course = np.linspace(*opinion.temperature_range, 200)
        curve, at_blocks = part.cubic.error(course), part.cubic.error(run.temperature)
        level = np.nanmean(run.measured[sensor] - at_blocks, axis=0)
        centre = at_blocks.mean(axis=0)
        for axis, (label, colour) in enumerate(AXIS_COLOURS.items()):
            dots = factor * (run.measured[sensor][:, axis] - level[axis] - centre[axis])
            panel.plot(run.temperature, dots, '.', ms=2, alpha=0.4, color=colour)
            line = factor * (curve[:, axis] - centre[axis])
            panel.plot(course, line, color=colour, lw=1.5, label=label)
            reach = factor * part.cooling[-1]
            panel.fill_between(course, line - reach, line + reach, color=colour, alpha=0.08, lw=0)
        panel.set(title=f'{name}, {sensor}', ylabel=f'error [{unit}]')
    panels[0].legend(fontsize='small', ncols=3, loc='upper right')
    panels[-1].set_xlabel('die temperature [°C]; band: what cooling may leave')
    return figure
