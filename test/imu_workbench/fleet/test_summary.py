# SPDX-License-Identifier: Apache-2.0
"""Entries of a study in the units of display: axes, limits and bounds by one factor."""

from __future__ import annotations

import math

import pytest
from imu_workbench.fleet.summary import displayed


def test_every_number_of_an_entry_is_in_the_unit_of_display_and_the_entry_is_kept() -> None:
    entry = {
        'sensor': 'gyroscope', 'unit': 'rad/s/K', 'lot': 'A', 'mean': [1e-5, 0.0, -2e-5],
        'std': [1e-6] * 3, 'limits': [-3e-5, 3e-5], 'lower': None, 'upper': 3e-5,
    }  # fmt: skip
    (shown,) = displayed([entry])
    factor = math.degrees(1.0) * 1e3
    assert (shown['unit'], shown['lot'], shown['lower']) == ('m°/s/K', 'A', None)
    assert shown['mean'] == pytest.approx([1e-5 * factor, 0.0, -2e-5 * factor])
    assert shown['std'] == pytest.approx([1e-6 * factor] * 3)
    assert shown['limits'] == pytest.approx([-3e-5 * factor, 3e-5 * factor])
    assert shown['upper'] == pytest.approx(3e-5 * factor)
    assert entry['mean'] == [1e-5, 0.0, -2e-5]


def test_the_shape_parameter_behind_the_axes_has_a_unit_of_its_own_and_is_left_out() -> None:
    entry = {'sensor': 'gyroscope', 'unit': 'rad/s/K', 'mean': [0.0, 0.0, 0.0, 4.3]}
    assert len(displayed([entry])[0]['mean']) == 3
