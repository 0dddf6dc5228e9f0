# SPDX-License-Identifier: Apache-2.0
"""What plotly.js draws: colours of the theme, layout of a phone, labels."""

from __future__ import annotations

import json
from unittest.mock import MagicMock

from imu_workbench.report.figures.panels import Figure, Panel, figure, trace_axes
from imu_workbench.web import plot
from imu_workbench.web.plot import Look, Plot, options_of

LINE = {
    'type': 'scatter', 'x': [0, 1], 'y': [0, 1], 'texttemplate': '%{y}', 'line': {'color': '@x'},
    **trace_axes(0),
}  # fmt: skip
FIGURE = figure([LINE], [Panel('time [h]', 'residual [°/s]')])


def test_colours_are_those_of_the_theme():
    light, dark = (json.dumps(options_of(FIGURE, Look(dark=dark))) for dark in (False, True))
    assert '@' not in light
    assert '@' not in dark
    assert light != dark


def test_a_phone_gets_its_own_layout_and_its_finger_scrolls():
    wide, phone = (options_of(FIGURE, Look(narrow=narrow)) for narrow in (False, True))
    assert 'texttemplate' in wide['data'][0]
    assert 'texttemplate' not in phone['data'][0]
    assert phone['layout']['dragmode'] is False
    assert phone['config']['displayModeBar'] is False
    touch = options_of(FIGURE, Look(touch=True))
    assert touch['layout']['dragmode'] is False
    assert touch['config']['displayModeBar'] is True
    assert FIGURE['layout'].get('dragmode') is not False, 'the figure itself has changed'


def test_a_figure_is_drawn_again_only_where_it_has_changed(monkeypatch):
    element = MagicMock()
    monkeypatch.setattr(plot, 'ui', MagicMock())
    monkeypatch.setattr(plot, 'PlotElement', element)
    look = Look()
    shown = Plot(look, 'a line')
    sent = element.return_value.classes.return_value.update_figure
    for drawn in (FIGURE, FIGURE, figure_to(2.0), figure_to(2.0), FIGURE):
        shown.show(drawn)
    assert element.call_count == 1
    assert [call.args[0]['data'][0]['y'] for call in sent.call_args_list] == [[0, 2.0], [0, 1]]
    look.dark = True
    shown.repaint()
    assert sent.call_count == 3
    shown.show(None)
    shown.show(FIGURE)
    assert element.call_count == 2


def figure_to(y: float) -> Figure:
    return figure([LINE | {'y': [0, y]}], [Panel('time [h]', 'residual [°/s]')])
