# SPDX-License-Identifier: Apache-2.0
"""The map of where a model fails: the ramps, in the colours of the report."""

from __future__ import annotations

import pytest
from imu_workbench.report.figures.modelled import FAILURE_COLOUR_SCALE
from imu_workbench.web.case.figures.failure_map import failure_figure, failure_map
from imu_workbench.web.case.view import View

VIEW = View('accelerometer', 2)


@pytest.mark.long
def test_the_line_fails_in_the_ramps_and_the_lag_does_not(fitted):
    before, after = (failure_map(version, VIEW) for version in (fitted.line, fitted.lag))
    assert {place.phase for place, _ in before.worst(6)} <= {'ramp_up', 'ramp_down'}
    assert before.worst(1)[0][1] > 10.0
    assert after.worst(1)[0][1] < 2.0


@pytest.mark.long
def test_the_map_has_the_colours_of_the_report(fitted):
    for version in (fitted.line, fitted.lag):
        axis = failure_figure(failure_map(version, VIEW), VIEW)['layout']['coloraxis']
        assert (axis['cmin'], axis['cmax']) == (
            FAILURE_COLOUR_SCALE['cmin'],
            FAILURE_COLOUR_SCALE['cmax'],
        )
