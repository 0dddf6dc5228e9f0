# SPDX-License-Identifier: Apache-2.0
"""Bars of the error: proposals are hatched, the noise floor is a line."""

from __future__ import annotations

from imu_workbench.report.figures.error_steps import error_steps_figure


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
