# SPDX-License-Identifier: Apache-2.0
"""The plan's figure shades dwells and names the parts of the run."""

from __future__ import annotations

from imu_workbench.report.figures.measured import plan_figure


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
