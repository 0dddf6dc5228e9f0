# SPDX-License-Identifier: Apache-2.0
"""Numbers for people."""

import doctest

import pytest
from thermal_comp.presentation import display


def test_examples_hold() -> None:
    assert doctest.testmod(display).failed == 0


@pytest.mark.parametrize(
    ('value', 'uncertainty', 'text'),
    [
        (0.0, 0.1, '0.00 ± 0.10'),
        (-1.0, 0.996, '−1.0 ± 1.0'),
        (123456.0, 321.0, '123 460 ± 320'),
        (1470.0, 1048.0, '1 500 ± 1 000'),
        (1.0, float('nan'), '1.00'),
        (0.0111234, 1.7e-6, '(1.11234 ± 0.00017)e−2'),
    ],
)
def test_uncertainty_sets_the_digits(value, uncertainty, text) -> None:
    assert display.with_uncertainty(value, uncertainty) == text
