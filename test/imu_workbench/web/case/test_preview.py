# SPDX-License-Identifier: Apache-2.0
"""A preview explains what its effect made, and a foreign one does not."""

from __future__ import annotations

import numpy as np
import pytest
from imu_workbench.web.case.figures.scatter import temperature_figure
from imu_workbench.web.case.figures.time_course import time_figure
from imu_workbench.web.case.preview import preview_task
from imu_workbench.web.case.view import View

VIEW = View('accelerometer', 2)


def test_a_preview_explains_what_its_effect_made_and_a_foreign_one_does_not(fitted):
    arguments = (fitted.prepared, fitted.line.model_text)
    lag = preview_task(lambda _: None, *arguments, 'thermal_lag', 'accelerometer', None, [])
    other = preview_task(lambda _: None, *arguments, 'humidity', 'accelerometer', None, [])
    assert min(lag.share) > 0.95
    assert max(other.share) < 0.7 * min(lag.share)
    assert lag.shape['time_constant'] == pytest.approx(74.0, rel=0.2)
    assert lag.error_after < 1.05 * fitted.line.floor('accelerometer') < other.error_after
    figure = time_figure(fitted.bags, fitted.line, VIEW, None, lag)
    drawn = {trace['name']: trace for trace in figure['data']}
    left = np.array([y for y in drawn['left with thermal lag']['y'] if y is not None])
    residual = np.array([y for y in drawn['residual (block means)']['y'] if y is not None])
    assert left.std() < 0.2 * residual.std()
    names = {trace['name'] for trace in temperature_figure(fitted.line, VIEW, lag)['data']}
    assert 'thermal lag would explain' in names
