# SPDX-License-Identifier: Apache-2.0
"""All figures of a case: one place, one part of the time, units on every axis."""

from __future__ import annotations

import json

from imu_workbench.case import CaseVersion
from imu_workbench.report.figures.palette import painted
from imu_workbench.web.case.figures.failure_map import failure_figure, failure_map
from imu_workbench.web.case.figures.noise import (
    allan_figure,
    spectrum_figure,
)
from imu_workbench.web.case.figures.scatter import phase_figure, rate_figure, temperature_figure
from imu_workbench.web.case.figures.time_course import time_figure
from imu_workbench.web.case.next_experiment import profile_figure, setpoint_of
from imu_workbench.web.case.versions_panel import error_steps_figure
from imu_workbench.web.case.view import View, timeline_of
from thermal_comp.experiment.plan import PAPER_PLAN

VIEW = View('accelerometer', 2)


def test_a_chosen_place_is_where_the_plots_go(fitted):
    place, _ = failure_map(fitted.line, VIEW).worst(1)[0]
    view = View('accelerometer', 2, place)
    timeline = timeline_of(fitted.bags)
    low, high = timeline.span(fitted.line.blocks, place)
    assert timeline.start(place.run) <= low < high <= timeline.start(place.run) + 13.0
    assert time_figure(fitted.bags, fitted.line, view)['layout']['xaxis']['range'] == [low, high]
    names = [trace['name'] for trace in temperature_figure(fitted.line, view)['data']]
    assert str(place) in names
    frames = failure_figure(failure_map(fitted.line, view), view)['layout']['shapes']
    assert len(frames) == 1


def test_a_part_of_the_time_is_all_that_any_figure_shows(fitted):
    window = (20.0, 21.0)
    view = View('accelerometer', 2, None, window)
    time = time_figure(fitted.bags, fitted.line, view)
    assert tuple(time['layout']['xaxis']['range']) == window
    hours = time['layout']['meta']['hours']
    assert (min(hours) >= 20.0, max(hours) <= 21.0, len(hours) > 100) == (True, True, True)
    inside = time['layout']['meta']['temperature']
    for trace in temperature_figure(fitted.line, view)['data']:
        if trace['mode'] == 'markers' and trace['name'] != 'cursor':
            assert min(inside) - 0.01 <= min(trace['x'])
            assert max(trace['x']) <= max(inside) + 0.01
    drawn = (sum(len(t['x']) for t in phase_figure(fitted.line, v)['data']) for v in (VIEW, view))
    assert next(drawn) > next(drawn)


def test_every_figure_is_plain_data_with_units_on_its_axes(fitted):
    found = failure_map(fitted.line, VIEW)
    figures = {
        'time': time_figure(fitted.bags, fitted.lag, VIEW, fitted.line),
        'before the fit': time_figure(fitted.bags, None, VIEW),
        'temperature': temperature_figure(fitted.line, VIEW),
        'rate': rate_figure(fitted.line, VIEW),
        'spectrum': spectrum_figure(fitted.line, VIEW),
        'allan': allan_figure(fitted.line, VIEW, fitted.bags),
        'stairs': error_steps_figure(
            [
                CaseVersion('v1', None, 'line', fitted.line.errors()),
                CaseVersion('v2', 'v1', 'lag', fitted.lag.errors()),
            ]
        ),
        'profile': profile_figure(setpoint_of(PAPER_PLAN)),
    }
    for name, figure in figures.items():
        titles = [
            axis['title']['text']
            for key, axis in figure['layout'].items()
            if key.startswith('yaxis')
        ]
        assert all('[' in title for title in titles), name
    figures |= {'map': failure_figure(found, VIEW), 'phase': phase_figure(fitted.line, VIEW)}
    for theme in ('light', 'dark'):
        assert '@' not in json.dumps(painted(figures, theme), allow_nan=False)
