# SPDX-License-Identifier: Apache-2.0
"""Figures show every value they are given, in panels that do not overlap."""

from __future__ import annotations

from itertools import pairwise

import pytest
from imu_workbench.report.figures.attitude import attitude_figure
from imu_workbench.report.figures.error_steps import error_steps_figure
from imu_workbench.report.figures.measured import plan_figure
from imu_workbench.report.figures.modelled import LARGEST_SHOWN_RATIO, failure_figure
from imu_workbench.report.figures.panels import Panel, figure, trace_axes


@pytest.mark.parametrize('columns', [1, 2, 3])
def test_panels_do_not_overlap(columns: int) -> None:
    count = 5
    spec = figure(
        [{'type': 'scatter', 'name': 'a', **trace_axes(i)} for i in range(count)],
        [Panel('t [h]', 'y [K]') for _ in range(count)],
        columns=columns,
    )
    layout = spec['layout']
    boxes = [
        (layout[f'xaxis{n}']['domain'], layout[f'yaxis{n}']['domain'])
        for n in ('', *range(3, 2 * count, 2))
    ]
    for i, (x, y) in enumerate(boxes):
        assert 0.0 <= x[0] < x[1] <= 1.0 + 1e-9
        for other_x, other_y in boxes[i + 1 :]:
            beside = x[1] <= other_x[0] or other_x[1] <= x[0]
            above = y[1] <= other_y[0] or other_y[1] <= y[0]
            assert beside or above
    heights = [spec['narrow'][f'yaxis{n}']['domain'] for n in ('', *range(3, 2 * count, 2))]
    assert all(upper[0] >= lower[1] for upper, lower in pairwise(heights))


def test_dwells_are_shaded_and_parts_of_the_run_named() -> None:
    phases = [
        {'phase': 'precondition', 'cycle': 0, 'from_h': 0.0, 'to_h': 1.0},
        {'phase': 'dwell_cold', 'cycle': 1, 'from_h': 1.0, 'to_h': 2.0},
        {'phase': 'dwell_hot', 'cycle': 1, 'from_h': 2.0, 'to_h': 3.0},
    ]
    track = {'x': [0.0, 3.0], 'y': [20.0, 20.0]}
    spec = plan_figure({'tracks': {'set-point': track}, 'phases': phases})
    assert [(s['x0'], s['x1']) for s in spec['layout']['shapes']] == [(1.0, 2.0), (2.0, 3.0)]
    texts = [mark['text'] for mark in spec['layout']['annotations']]
    assert texts[:2] == ['Ref.', 'R1']


def test_ratios_beyond_the_scale_keep_their_number() -> None:
    where = {'phases': ['dwell_hot'], 'cycles': [1, 2], 'ratio': [[50.0, None]]}
    trace, numbers = failure_figure({'': where})['data']
    assert trace['z'] == [[pytest.approx(1.0), None]]  # log10 of the largest that is shown
    assert LARGEST_SHOWN_RATIO == 10.0
    assert trace['text'] == [['50 ×', '']]
    assert (numbers['customdata'], numbers['textfont']['color']) == (['50 ×'], ['@on_loud'])


def test_proposed_steps_are_hatched_and_the_floor_is_drawn() -> None:
    part = {
        'unit': '°/s',
        'steps': [{'label': 'measured', 'error': 1.0}],
        'proposed': [{'label': '+ lag', 'error': 0.1}],
        'floor': 0.05,
    }
    spec = error_steps_figure({'gyroscope': part})
    assert [bar['marker']['pattern']['shape'] for bar in spec['data']] == ['', '/']
    assert spec['layout']['shapes'][0]['y0'] == 0.05
    low, high = spec['layout']['yaxis']['range']
    assert 10.0**low < 0.05
    assert 10.0**high > 1.0


def test_only_the_data_asked_for_are_drawn() -> None:
    line = {angle: {'x': [0.0], 'y': [1.0]} for angle in ('yaw', 'pitch', 'roll')}
    series = {'ahrs': {'raw': line, 'compensated': line}}
    assert len(attitude_figure(series, ('raw',))['data']) == 3
    assert len(attitude_figure(series, ('raw', 'compensated'))['data']) == 6
