# SPDX-License-Identifier: Apache-2.0
"""Panels of a figure do not overlap, on a screen or a phone."""

from __future__ import annotations

from itertools import pairwise

import pytest
from imu_workbench.report.figures.panels import (
    TOOLBAR_PX,
    Figure,
    Panel,
    figure,
    trace_axes,
)


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


def test_a_legend_without_room_beside_the_toolbar_stands_below_it() -> None:
    def with_names(*names: str) -> Figure:
        traces = [{'type': 'bar', 'name': name, 'legendgroup': name} for name in names]
        return figure(traces, [Panel('', '')])

    short, long = with_names('x', 'y'), with_names(*(f'dwell of cycle {k}' for k in range(6)))
    assert short['layout']['legend']['y'] == 1.0
    lower = (1.0 - long['layout']['legend']['y']) * long['layout']['height']
    assert lower == pytest.approx(TOOLBAR_PX)
    more = long['layout']['margin']['t'] - short['layout']['margin']['t']
    assert more == TOOLBAR_PX
    assert long['narrow']['legend']['y'] == 1
