# SPDX-License-Identifier: Apache-2.0
"""Numbers for people, and the published tables."""

import doctest

import pytest
from imu_workbench.tables import paper
from thermal_comp.presentation import display


def test_examples_hold() -> None:
    assert doctest.testmod(display).failed == 0


@pytest.mark.parametrize(
    ('value', 'uncertainty', 'text'),
    [
        (0.0, 0.1, '0.00 ± 0.10'),
        (-1.0, 0.996, '−1.0 ± 1.0'),
        (123456.0, 321.0, '123 456 ± 321'),
        (1.0, float('nan'), '1.00'),
        (0.0111234, 1.7e-6, '(1.11234 ± 0.00017)e−2'),
    ],
)
def test_uncertainty_sets_the_digits(value, uncertainty, text) -> None:
    assert display.with_uncertainty(value, uncertainty) == text


def test_the_published_tables_are_complete() -> None:
    rows = paper.tables_3_4_5()
    assert len(rows) == 3 * 9 * 5
    assert {row['segment'] for row in rows} == set(paper.SEGMENTS)
    ranges = {
        name: max(r['max'] - r['min'] for r in rows if r['quantity'].startswith(name))
        for name in paper.OVERALL_RANGES
    }
    assert ranges['magnetometer'] == pytest.approx(132.01)
    angles = paper.tables_6_7()
    assert len(angles) == 2 * 3 * 2 * 3
    assert {row['euler_angle'] for row in angles} == set(paper.ANGLES)
