# SPDX-License-Identifier: Apache-2.0
"""The large numbers of the summary are of one channel each."""

from __future__ import annotations

import math

from imu_workbench.report.html.claims import sensor_card


def errors(before: list[float], after: list[float], floor: list[float]):
    return {
        'errors': [
            {'sensor': 'accelerometer', 'axis': axis, 'before': b, 'after': a, 'floor': f,
             'ratio': a / f, 'unit': 'm/s²'}
            for axis, b, a, f in zip('xyz', before, after, floor, strict=True)
        ]
    }  # fmt: skip


def test_before_after_and_floor_are_of_the_channel_that_fails_most() -> None:
    content = {
        'certificates': {
            'a': errors([9.0, 2.0, 1.0], [0.5, 0.4, math.nan], [0.5, 0.1, 0.1]),
            'b': errors([3.0, 3.0, 3.0], [0.9, 0.6, 0.6], [0.6, 0.6, 0.6]),
        }
    }
    card = sensor_card(content, 'accelerometer')
    assert card is not None
    assert card['value'] == '2.00 → 0.400'
    assert card['detail'].startswith(
        'a y: measured → certified model, held out; noise floor 0.100'
    )
    assert sensor_card(content, 'gyroscope') is None
