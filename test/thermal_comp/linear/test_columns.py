# SPDX-License-Identifier: Apache-2.0
"""Columns of runs and axes stand where they belong; a basis has as many as are independent."""

import numpy as np
import pytest
from thermal_comp.linear.columns import (
    LEAST_NEW_LENGTH,
    log_volume,
    orthonormal,
    per_axis,
    project_out,
    stack_runs,
)
from thermal_comp.linear.normal_equations import factor, pseudo_solve

RNG = np.random.default_rng(3)


def test_a_basis_spans_the_columns_and_leaves_nothing_of_them() -> None:
    columns = RNG.standard_normal((50, 3)) * [1e-9, 1.0, 1e9]
    dependent = np.column_stack([columns, columns @ [1e9, 2.0, 0.0], np.zeros(50)])
    basis = orthonormal(dependent)
    assert basis.shape == (50, 3)
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=1e-12)
    left = project_out(basis, dependent)
    assert (np.linalg.norm(left, axis=0) <= 1e-12 * np.linalg.norm(dependent, axis=0)).all()


@pytest.mark.parametrize(('share', 'rank'), [(0.1, 2), (10.0, 3)])
def test_bases_and_solutions_of_columns_agree_on_their_rank(share: float, rank: int) -> None:
    columns = np.linalg.qr(RNG.standard_normal((50, 3)))[0]
    columns[:, 2] = columns[:, :2].sum(axis=1) + share * LEAST_NEW_LENGTH * columns[:, 2]
    columns *= [1e-12, 1.0, 1e6]
    assert orthonormal(columns).shape[1] == rank
    assert pseudo_solve(columns.T @ columns, columns.T @ columns)[1] == rank
    assert len(factor(columns.T @ columns).kept) == rank
    lengths = np.log(np.linalg.norm(columns, axis=0)).sum()
    assert (log_volume(columns) < lengths - 5.0) == (rank == 3)  # a short direction that counts


def test_nothing_has_an_empty_basis() -> None:
    for columns in (np.zeros((5, 2)), np.zeros((5, 0))):
        basis = orthonormal(columns)
        assert basis.shape == (5, 0)
        np.testing.assert_array_equal(project_out(basis, np.ones((5, 1))), np.ones((5, 1)))


def test_columns_that_act_on_one_axis_each_are_each_axis_own() -> None:
    columns = np.zeros((4, 3, 3))
    columns[:, [0, 1, 2], [0, 1, 2]] = RNG.standard_normal((4, 3))
    own, shared = per_axis(columns)
    assert not shared
    np.testing.assert_array_equal(own[:, :, 0], columns[:, [0, 1, 2], [0, 1, 2]])
    turned, shared = per_axis(RNG.standard_normal((4, 3, 3)))
    assert shared
    assert turned.shape == (4, 3, 3)


def test_runs_stand_below_each_other_each_with_its_own_columns_where_asked() -> None:
    parts = [np.ones((2, 3, 1)), 2.0 * np.ones((4, 3, 1))]
    assert stack_runs(parts, per_run=False).shape == (6, 3, 1)
    own = stack_runs(parts, per_run=True)
    np.testing.assert_array_equal(own[:, 0], [[1, 0]] * 2 + [[0, 2]] * 4)
