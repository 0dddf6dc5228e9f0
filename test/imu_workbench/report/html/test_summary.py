# SPDX-License-Identifier: Apache-2.0
"""The large numbers of the summary are of one channel each."""

from __future__ import annotations

from imu_workbench.report.html.claims import sensor_card


def part(measured: list[float | None], held_out: list[float | None], floor: list[float | None]):
    rows = {'measured_rms': measured, 'held_out_rms': held_out, 'noise_floor': floor}
    return {'sensors': {'accelerometer': rows}}


def test_before_after_and_floor_are_of_the_channel_that_fails_most() -> None:
    content = {
        'comparison': {
            'a': part([9.0, 2.0, None], [0.5, 0.4, None], [0.5, 0.1, None]),
            'b': part([3.0, 3.0, 3.0], [0.9, 0.6, 0.6], [0.6, 0.6, 0.6]),
        }
    }
    card = sensor_card(content, 'accelerometer')
    assert card is not None
    assert card['value'] == '2.00 → 0.400'
    assert card['detail'].startswith('a y: measured → held out; noise floor 0.100')
    assert sensor_card(content, 'gyroscope') is None
