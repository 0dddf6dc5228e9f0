# SPDX-License-Identifier: Apache-2.0
"""Curves from stretches at rest as content, as lines and as a picture that agree."""

from __future__ import annotations

from functools import cache

import numpy as np
from thermal_comp.presentation.still import (
    curves_content,
    curves_text,
    not_visited,
    rest_content,
    rest_text,
    still_picture,
)
from thermal_comp.still.curves import StillCurves, still_curves
from thermal_comp.still.log import resting_log

from ..still.parked import LOGS, SLOPE, parked


@cache
def curves() -> StillCurves:
    return still_curves([resting_log(parked(number))[0] for number in range(LOGS)])


def test_the_table_steps_through_the_range_from_end_to_end() -> None:
    part = curves_content(curves())['sensors']['accelerometer']
    t = part['temperature']
    assert t[0] == curves().temperature[0]
    assert t[-1] == curves().temperature[-1]
    assert (t[1:-1] % 5.0 == 0.0).all()
    change = part['curve'][-1] - part['curve'][0]
    np.testing.assert_allclose(change[:2], SLOPE[:2] * (t[-1] - t[0]), rtol=0.3)


def test_temperatures_between_the_logs_are_named_as_not_visited() -> None:
    gaps = not_visited(curves())
    degrees = [degree for low, high in gaps for degree in np.arange(low, high + 1.0)]
    assert sorted(degrees) == curves().temperature[curves().minutes == 0.0].tolist()
    lines = curves_text(curves_content(curves()))
    assert any(line.startswith(f'never at rest at {gaps[0][0]:g}') for line in lines)


def test_the_lines_hold_every_temperature_in_the_units_of_the_picture() -> None:
    content = curves_content(curves())
    lines = curves_text(content)
    for sensor, unit in (('accelerometer', 'mm/s²'), ('gyroscope', '°/s')):
        (head,) = [k for k, line in enumerate(lines) if line.startswith(f'{sensor} [{unit}]')]
        rows = len(content['sensors'][sensor]['temperature'])
        cells = [line.split() for line in lines[head + 2 : head + 2 + rows]]
        assert [float(row[0]) for row in cells] == [
            float(f'{t:g}') for t in content['sensors'][sensor]['temperature']
        ]
    panels = still_picture(curves()).axes
    assert [panel.get_ylabel() for panel in panels] == [
        'change [mm/s²]',
        'change [°/s]',
        'at rest [min]',
    ]


def test_each_log_has_a_line_with_its_time_at_rest() -> None:
    logs = curves().logs
    rows = rest_content(logs)
    head, *lines = rest_text(rows)
    assert 'at rest' in head
    assert [line.split()[0] for line in lines] == [log.name for log in logs]
    for row, log in zip(rows, logs, strict=True):
        assert 30.0 < row['rest_s'] <= row['duration_s'] == log.seconds
        low, high = row['stretches'][0]['temperature']
        assert high - low < 1.0
