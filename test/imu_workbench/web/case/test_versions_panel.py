# SPDX-License-Identifier: Apache-2.0
"""A staircase is read off at any height and any length."""

import math

import pytest
from imu_workbench.case import CaseVersion
from imu_workbench.report.figures.error_steps import logarithmic_axis
from imu_workbench.web.case.versions_panel import MOST_LABELS, error_steps_figure


def staircase(errors: list[float]):
    return error_steps_figure(
        [
            CaseVersion(f'v{k}', None, 'line', {
                'accelerometer': {'measured': 0.1, 'error': error, 'floor': 1e-3}
            })
            for k, error in enumerate(errors, 1)
        ]
    )  # fmt: skip


def test_of_many_versions_only_the_ends_carry_their_number() -> None:
    few, many = (staircase([0.01] * (n - 1) + [0.002]) for n in (MOST_LABELS, MOST_LABELS + 1))
    assert '' not in few['data'][0]['text']
    texts = many['data'][0]['text']
    assert (texts[0], texts[-1]) == ('0.100', '0.00200')
    assert set(texts[1:-1]) == {''}


@pytest.mark.parametrize('low', [1.0, 1.7, 2.1, 3.3, 5.2, 9.9])
def test_a_logarithmic_axis_has_labels_wherever_its_values_lie(low: float) -> None:
    axis = logarithmic_axis([low, 1.05 * low])
    labels = [math.log10(digit) + decade for digit in (1, 2, 5) for decade in range(-2, 4)]
    assert axis['dtick'] == 'D2'
    assert sum(axis['range'][0] <= label <= axis['range'][1] for label in labels) >= 2
    assert logarithmic_axis([1e-3, 1.0])['dtick'] == 1
