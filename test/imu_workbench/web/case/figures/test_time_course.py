# SPDX-License-Identifier: Apache-2.0
"""Lines over time keep holes and extremes; a zoom shows every sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_workbench.web.case.figures.time_course import sample_line, time_lines
from imu_workbench.web.case.view import View

VIEW = View('accelerometer', 2)


def test_no_line_is_drawn_where_nothing_was_recorded(fitted):
    whole, *others = fitted.line.blocks
    hours = whole.time / 3600.0
    cut = replace(fitted.line, blocks=(whole.at((hours < 5.0) | (hours > 6.0)), *others))
    for line in ('modelled', 'residual'):
        y, full = (time_lines(fitted.bags, v, VIEW)[line]['y'] for v in (cut, fitted.line))
        assert y.count(None) == full.count(None) + 1


def test_lines_keep_the_extremes_and_a_zoom_shows_every_sample(fitted):
    bag = fitted.bags[0]
    values = bag.measured('accelerometer')[:, 2]
    _, drawn = sample_line(bag, 'accelerometer', 2, (0.0, bag.duration), 100)
    assert len(drawn) < 200
    assert (np.nanmin(drawn), np.nanmax(drawn)) == (values.min(), values.max())
    time, inside = sample_line(bag, 'accelerometer', 2, (3600.0, 7200.0), 2000)
    assert len(inside) == pytest.approx(360, abs=3)
    assert time[0] == pytest.approx(3600.0, abs=11.0)
    zoomed = time_lines(fitted.bags, fitted.line, VIEW, (20.0, 21.0))
    assert max(x for x in zoomed['measured']['x'] if x is not None) < 21.1
