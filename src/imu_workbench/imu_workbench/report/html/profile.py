# SPDX-License-Identifier: Apache-2.0
"""The timetable of a chamber profile as one HTML page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from imu_workbench.profile_timetable import clock, course
from imu_workbench.report.figures.measured import plan_figure
from imu_workbench.report.html.render import Section, render_page


def profile_page(content: Mapping[str, Any]) -> str:
    """Return what `plan` says of a profile (the dictionary that --json writes) as a page."""
    sections = (setpoint_section(content), timetable_section(content))
    return render_page(content['profile'], content['description'], sections)


def setpoint_section(content: Mapping[str, Any]) -> Section:
    """Return the set-point over time, limits and abort."""
    hours = np.asarray(content['setpoint']['time_s']) / 3600.0
    setpoint = np.asarray(content['setpoint']['temperature_c'])
    phases = [
        {
            'phase': step['phase'],
            'cycle': step['cycle'],
            'from_h': step['start_s'] / 3600.0,
            'to_h': (step['start_s'] + step['duration_s']) / 3600.0,
        }
        for step in content['steps']
    ]
    series = {'x': hours.tolist(), 'y': setpoint.tolist()}
    figures = {'plan': plan_figure({'tracks': {'set-point': series}, 'phases': phases})}
    low, high = content['limits']['air_c']
    abort = content['on_abort']
    facts = {
        'Duration': clock(content['duration_s']),
        'Set-point': f'{content["lowest_c"]:g} … {content["highest_c"]:g} °C',
        'Limits of the air': f'{low:g} … {high:g} °C',
        'Fastest ramp allowed': f'{content["limits"]["rate_max_c_per_min"]:g} °C/min',
        'Violations of the limits': 'none',
        'A dwell starts with the': content['dwell_starts'],
        'On abort': (
            f'to {abort["target_c"]:g} °C at {abort["rate_c_per_min"]:g} °C/min, then stop'
        ),
    }
    values = {'facts': facts, 'sha256': content['sha256']}
    return Section('setpoint', 'Set-point', 'profile_setpoint.html', values, figures)


def timetable_section(content: Mapping[str, Any]) -> Section:
    """Return start, length and set-point of every step."""
    rows = [
        [
            step['id'],
            str(step['cycle'] or ''),
            clock(step['start_s']),
            clock(step['duration_s']),
            course(step),
        ]
        for step in content['steps']
    ]
    return Section('timetable', 'Timetable', 'profile_timetable.html', {'rows': rows})
