# SPDX-License-Identifier: Apache-2.0
"""Evidences by small eigenproblems are those of the rows' own dense covariance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import block_diag
from thermal_comp.linear.gaussian_evidence import (
    NOISE_ROWS,
    CoefficientPrior,
    conditioned,
    joint_evidence,
)

ROWS, WIDTH = 40, 12


@pytest.fixture
def rows():
    """Columns (3, rows, c) of unit length over the axes together, and the rows (3, rows)."""
    random = np.random.default_rng(5)
    columns = random.normal(size=(3, ROWS, WIDTH))
    columns /= np.sqrt((columns**2).sum(axis=(0, 1)))
    target = random.normal(size=(3, ROWS)) + 20.0 * columns[:, :, 2]
    return columns, target


def student_t(rows, priors):
    """Return ln of the density of the rows by their dense covariance, less that of noise alone."""
    columns, target = rows
    covariance = np.eye(3 * ROWS)
    for prior in priors:
        own = [columns[axis][:, prior.columns] * prior.deviation for axis in range(3)]
        stacked = np.concatenate(own) if prior.shared else block_diag(*own)
        covariance += stacked @ stacked.T
    flat = target.ravel()
    chi_square = flat @ np.linalg.solve(covariance, flat)
    count = 3 * ROWS + NOISE_ROWS
    left = (chi_square + NOISE_ROWS) / count
    return -0.5 * np.linalg.slogdet(covariance)[1] - 0.5 * count * np.log(left)


def equations(rows):
    columns, target = rows
    normal = np.einsum('anp,anq->apq', columns, columns)
    right = np.einsum('anp,an->ap', columns, target)
    return normal, right, float((target**2).sum()), 3 * ROWS


OWN = CoefficientPrior((0, 1), shared=False, deviation=np.array([2.0, 5.0]))
SHARED = CoefficientPrior((3, 4), shared=True, deviation=np.array([30.0, 1.0]))
MANY = CoefficientPrior((0, 1, 3, 4, 8, 9, 10), shared=True, deviation=np.geomspace(0.1, 30.0, 7))
"""More than a form has over the axes."""


@pytest.mark.parametrize('priors', [(), (OWN,), (SHARED,), (OWN, SHARED)])
def test_what_is_integrated_out_counts_as_in_the_dense_covariance(rows, priors):
    expected = student_t(rows, priors)
    assert joint_evidence(*equations(rows), priors)[0] == pytest.approx(expected, abs=1e-9)
    state = conditioned(*equations(rows), priors)
    assert state.log_evidence == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize('shared', [False, True])
@pytest.mark.parametrize('priors', [(), (OWN,), (SHARED,), (OWN, SHARED), (MANY,)])
def test_every_form_at_every_width_counts_as_in_the_dense_covariance(rows, priors, shared):
    state = conditioned(*equations(rows), priors)
    forms, widths = np.array([[2, 5], [6, 7]]), np.array([0.5, 40.0])
    relative = np.array([[1.0, 0.1], [0.3, 1.0]])
    evidence, gain = state.evidences(forms, widths, shared=shared, relative=relative)
    for place, form in enumerate(forms):
        for number, width in enumerate(widths):
            tried = CoefficientPrior(tuple(form), shared, width * relative[place])
            expected = student_t(rows, (*priors, tried))
            assert evidence[place, number] == pytest.approx(expected, abs=1e-9)
            together = [*priors, tried]
            joint = joint_evidence(*equations(rows), together)
            left = state.chi_square - gain[place, number]
            assert left == pytest.approx(equations(rows)[2] - joint[1], abs=1e-9)
