# SPDX-License-Identifier: Apache-2.0
"""A picture of a second opinion: dots about a curve, in the units it is asked in."""

import numpy as np
from thermal_comp.presentation.second_opinion import opinion_picture
from thermal_comp.second_opinion.opinion import second_opinion

from ..second_opinion.warm_ups import NOISE, warmed

UNITS = {'accelerometer': (1e3, 'mm/s²'), 'gyroscope': (180.0 / np.pi, '°/s')}


def test_each_sensor_has_a_panel_with_dots_about_its_curves() -> None:
    opinion = second_opinion(warmed(back=False, lag=False)[0], 'px4')
    figure = opinion_picture([('board', opinion)], UNITS)
    panels = figure.axes
    assert [panel.get_title() for panel in panels] == ['board, accelerometer', 'board, gyroscope']
    assert [panel.get_ylabel() for panel in panels] == ['error [mm/s²]', 'error [°/s]']
    lines = panels[0].get_lines()
    assert len(lines) == 6
    for dots, curve in zip(lines[::2], lines[1::2], strict=True):
        at_dots = np.interp(dots.get_xdata(), curve.get_xdata(), curve.get_ydata())
        off = dots.get_ydata() - at_dots
        assert np.sqrt(np.mean(off**2)) < 2e3 * NOISE
        assert np.ptp(curve.get_ydata()) > 20e3 * NOISE
