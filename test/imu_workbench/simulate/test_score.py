# SPDX-License-Identifier: Apache-2.0
"""A diagnosis scored against the truth: named, in the set, missed, wrong."""

from typing import Any

import pytest
from imu_workbench.simulate.score import score_diagnosis, score_each

LAG = {'kind': 'effect', 'name': 'thermal_lag', 'sensor': 'gyroscope', 'depends_on': []}


def test_what_is_found_of_one_effect_does_not_count_against_another() -> None:
    lag = {'kind': 'effect', 'name': 'thermal_lag', 'sensor': 'gyroscope', 'depends_on': []}
    ice = lag | {'name': 'icing'}
    walk = lag | {'name': 'warm_up'}
    scores = score_each([lag, ice, walk], {'findings': [ice, lag]})
    assert [score.outcome for score in scores] == ['named', 'named', 'missed']


def finding(**values: Any) -> dict[str, Any]:
    return {'kind': 'effect', 'ambiguous_with': [], 'depends_on': None, **values}


@pytest.mark.parametrize(
    ('truth', 'findings', 'outcome', 'right'),
    [
        (LAG, [finding(name='thermal_lag', sensor='gyroscope')], 'named', True),
        (LAG, [finding(name='thermal_lag', sensor='magnetometer')], 'named', False),
        (
            LAG,
            [finding(name='temperature_rate', sensor='gyroscope', ambiguous_with=['thermal_lag'])],
            'in_set',
            True,
        ),
        (LAG, [finding(name='temperature_rate', sensor='gyroscope')], 'wrong', False),
        (LAG, [finding(kind='unexplained', name=None, sensor='gyroscope')], 'wrong', False),
        (LAG, [finding(kind='noise', name=None, sensor='gyroscope')], 'missed', False),
        (LAG, [], 'missed', False),
        ({'kind': 'nothing', 'name': None, 'sensor': None}, [], 'named', True),
        (
            {'kind': 'nothing', 'name': None, 'sensor': None},
            [finding(kind='noise', name=None, sensor='all')],
            'named',
            True,
        ),
        (
            {'kind': 'nothing', 'name': None, 'sensor': None},
            [finding(name='icing', sensor='gyroscope')],
            'wrong',
            True,
        ),
        (
            {
                'kind': 'unexplained',
                'name': None,
                'sensor': 'gyroscope',
                'depends_on': ['temperature', 'time'],
            },
            [finding(kind='unexplained', name=None, sensor='gyroscope', depends_on='time')],
            'named',
            True,
        ),
        (
            {
                'kind': 'unlogged',
                'name': None,
                'sensor': 'magnetometer',
                'depends_on': ['heater', 'chamber'],
            },
            [finding(kind='unlogged', name=None, sensor='magnetometer', depends_on='chamber')],
            'named',
            True,
        ),
        (
            {
                'kind': 'unlogged',
                'name': None,
                'sensor': 'magnetometer',
                'depends_on': ['heater', 'chamber'],
            },
            [finding(name='thermal_gradient', sensor='magnetometer')],
            'wrong',
            False,
        ),
        (
            {'kind': 'data_quality', 'name': 'spikes', 'sensor': 'gyroscope'},
            [finding(kind='data_quality', name='spikes', sensor='gyroscope')],
            'named',
            True,
        ),
    ],
)
def test_a_diagnosis_is_judged_by_the_truth(
    truth: dict[str, Any], findings: list[dict[str, Any]], outcome: str, right: bool
) -> None:
    score = score_diagnosis(truth, {'findings': findings})
    assert score.outcome == outcome
    assert score.right == (right and outcome != 'wrong')
