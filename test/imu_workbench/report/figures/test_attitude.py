# SPDX-License-Identifier: Apache-2.0
"""The figure of attitudes draws the data that are asked for."""

from __future__ import annotations

from imu_workbench.report.figures.attitude import attitude_figure


def test_only_the_data_asked_for_are_drawn() -> None:
    line = {angle: {'x': [0.0], 'y': [1.0]} for angle in ('yaw', 'pitch', 'roll')}
    series = {'ahrs': {'raw': line, 'compensated': line}}
    assert len(attitude_figure(series, ('raw',))['data']) == 3
    assert len(attitude_figure(series, ('raw', 'compensated'))['data']) == 6
