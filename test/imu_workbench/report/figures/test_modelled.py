# SPDX-License-Identifier: Apache-2.0
"""The heat map of a residual keeps numbers beyond its scale."""

from __future__ import annotations

import pytest
from imu_workbench.report.figures.modelled import LARGEST_SHOWN_RATIO, failure_figure
from imu_workbench.report.figures.panels import TOOLBAR_PX


def test_ratios_beyond_the_scale_keep_their_number() -> None:
    where = {'phases': ['dwell_hot'], 'cycles': [1, 2], 'ratio': [[50.0, None]]}
    trace, numbers = failure_figure({'': where})['data']
    assert trace['z'] == [[pytest.approx(1.0), None]]  # log10 of the largest that is shown
    assert LARGEST_SHOWN_RATIO == 10.0
    assert trace['text'] == [['50 ×', '']]
    assert (numbers['customdata'], numbers['textfont']['color']) == (['50 ×'], ['@on_loud'])


def test_a_map_without_a_title_leaves_room_for_the_toolbar_above_its_colour_bar() -> None:
    where = {'phases': ['dwell_hot'], 'cycles': [1, 2], 'ratio': [[2.0, 3.0]]}
    plain, titled = failure_figure({'': where}), failure_figure({'line per axis': where})
    assert plain['layout']['margin']['t'] >= TOOLBAR_PX
    assert titled['layout']['margin']['t'] >= TOOLBAR_PX
    assert plain['narrow']['margin']['t'] < TOOLBAR_PX
