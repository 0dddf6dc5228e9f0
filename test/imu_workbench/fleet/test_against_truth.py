# SPDX-License-Identifier: Apache-2.0
"""The study of a simulated fleet is scored against the truth it was drawn from."""

from typing import Any

import pytest
from imu_workbench.fleet.against_truth import score_fleet

LAG = {'name': 'thermal_lag', 'sensor': 'gyroscope'}
TRUTH: dict[str, Any] = {
    'devices': {
        'a': {'lot': 'A', 'outlier': False, 'effects': [LAG]},
        'b': {'lot': 'A', 'outlier': True, 'effects': []},
        'c': {'lot': 'A', 'outlier': False, 'effects': []},
        'd': {'lot': 'A', 'outlier': False, 'effects': [LAG]},
    },
    'lots': {
        'A': {
            'mean': [0.0] * 9,
            'covariance': [[4.0 * (i == j) for j in range(9)] for i in range(9)],
            'effects': [LAG],
        }
    },
}
STUDY: dict[str, Any] = {
    'odd': [{'device': 'b'}, {'device': 'c'}],
    'populations': [{'lot': 'A', 'sensor': 'gyroscope', 'mean': [0.0, -3.0, 1.0]}],
    'prevalence': [
        {'lot': 'A', 'sensor': 'gyroscope', 'effect': 'thermal_lag', 'named': True, 'share': 0.4}
    ],
}


def test_outliers_false_alarms_means_and_shares_are_counted() -> None:
    score = score_fleet(STUDY, TRUTH)
    assert (score['outliers'], score['outliers_found']) == (1, 1)
    assert score['false_alarms'] == pytest.approx(1.0 / 3.0)  # of the devices that are ordinary
    assert score['worst_mean_error'] == pytest.approx(1.5)  # in σ of the lot, √4
    assert score['prevalence'] == [
        {'lot': 'A', 'effect': 'thermal_lag', 'sensor': 'gyroscope', 'true': 0.5, 'found': 0.4}
    ]


def test_an_effect_of_another_sensor_is_not_found() -> None:
    elsewhere = [STUDY['prevalence'][0] | {'sensor': 'accelerometer'}]
    score = score_fleet(STUDY | {'prevalence': elsewhere}, TRUTH)
    assert score['prevalence'][0]['found'] == 0.0
