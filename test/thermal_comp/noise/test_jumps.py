# SPDX-License-Identifier: Apache-2.0
"""Jumps of the level between blocks are found to the block; a level that switches has none."""

import numpy as np
import pytest
from thermal_comp.noise.jumps import MOST_JUMPS, basis_with_jumps, jump_columns

ROWS = 400
LEVEL = np.full((ROWS, 1), ROWS**-0.5)
"""An orthonormal basis of the level alone."""
SLOT = np.arange(ROWS)


def jumping(*at: int, size: float = 40.0) -> np.ndarray:
    """(400, 3) white noise of unit deviation whose second axis jumps after these blocks."""
    values = np.random.default_rng(6).normal(size=(ROWS, 3))
    for number, row in enumerate(at):
        values[row + 1 :, 1] += size * (-1.0) ** number
    return values


@pytest.mark.parametrize('at', [(), (150,), (60, 150, 330)])
def test_each_jump_is_a_step_after_its_block(at: tuple[int, ...]) -> None:
    steps = jump_columns(jumping(*at), SLOT, LEVEL)
    assert sorted(np.argmax(steps > 0.0, axis=0).tolist()) == [row + 1 for row in at]


def test_a_basis_with_jumps_leaves_noise() -> None:
    values = jumping(60, 150)
    basis = basis_with_jumps(values, SLOT, LEVEL)
    assert basis.shape == (ROWS, 3)
    left = values - basis @ (basis.T @ values)
    assert left.std(axis=0) == pytest.approx(1.0, rel=0.15)


def test_a_jump_in_a_gap_and_a_level_that_switches_are_left_alone() -> None:
    values = jumping(150)
    assert jump_columns(values, SLOT + 20 * (SLOT > 150), LEVEL).shape == (ROWS, 0)
    often = range(20, 20 + 40 * (MOST_JUMPS + 2), 40)
    assert jump_columns(jumping(*often), SLOT, LEVEL).shape == (ROWS, 0)


def test_steps_are_weighted_as_the_values_are() -> None:
    weights = np.where(SLOT < 300, 1.0, 0.5)
    basis = weights[:, None] / np.linalg.norm(weights)
    (step,) = jump_columns(weights[:, None] * jumping(150, size=80.0), SLOT, basis, weights).T
    np.testing.assert_array_equal(step, weights * (SLOT > 150))
