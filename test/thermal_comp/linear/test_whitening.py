# SPDX-License-Identifier: Apache-2.0
"""Rows of several runs are whitened run by run; gaps and axes have filters of their own."""

import numpy as np
import pytest
from thermal_comp.linear.whitening import (
    RowWhitening,
    apply_gains,
    apply_transposed,
    innovation_gains,
)
from thermal_comp.model.values import NoiseModel

NOISE = NoiseModel(
    np.array([1.0, 2.0, 3.0]), np.array([50.0, 900.0]), np.array([[0.1, 0.2, 0.3]] * 2)
)
SLOTS = [np.arange(40), np.r_[0:20, 35:60]]


def test_stacked_rows_are_whitened_as_each_run_is() -> None:
    columns = np.random.default_rng(2).standard_normal((85, 3, 2))
    whitening = RowWhitening(SLOTS, [NOISE, NOISE], [20.0, 5.0])
    found = whitening.whitened(columns)
    assert len(whitening) == 85
    for run, (slot, period) in enumerate(zip(SLOTS, (20.0, 5.0), strict=True)):
        rows = whitening.rows_of(run)
        for axis in range(3):
            gains = innovation_gains(slot, NOISE, axis, period)
            np.testing.assert_array_equal(
                found[axis, rows], apply_gains(columns[rows, axis], gains)
            )
    own = np.ascontiguousarray(columns[:, 1].T)
    whitening.whiten_in_place(own, 1)
    np.testing.assert_array_equal(own.T, found[1])


@pytest.mark.parametrize('width', range(1, 10))
def test_columns_are_whitened_each_as_by_itself(width: int) -> None:
    columns = np.random.default_rng(3).standard_normal((45, width))
    gains = innovation_gains(SLOTS[1], NOISE, 0, 20.0)
    found = apply_gains(columns, gains)
    for k in range(width):
        np.testing.assert_array_equal(found[:, [k]], apply_gains(columns[:, [k]], gains))


def test_the_transposed_filter_is_the_transpose() -> None:
    gains = innovation_gains(SLOTS[1], NOISE, 0, 20.0)
    matrix = apply_gains(np.eye(45), gains)
    np.testing.assert_allclose(apply_transposed(np.eye(45), gains), matrix.T, atol=1e-14)
