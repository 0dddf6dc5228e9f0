# SPDX-License-Identifier: Apache-2.0
"""Solve normal equations so that what cannot be told apart is named, never split by accident."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

DEPENDENT = 1e-10
"""A column of which less than this share of its power is new depends on the columns before it."""


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Sums over whitened rows, for q right-hand sides."""

    gram: FloatArray
    """(m, m) XᵀX."""
    moment: FloatArray
    """(m, q) XᵀY."""
    energy: FloatArray
    """(q,) diagonal of YᵀY."""
    rows: int

    def __add__(self, other: NormalEquations) -> NormalEquations:
        return NormalEquations(
            self.gram + other.gram,
            self.moment + other.moment,
            self.energy + other.energy,
            self.rows + other.rows,
        )


@dataclass(frozen=True, eq=False)
class Solution:
    """Estimates of all unknowns; those that depend on earlier ones are held at zero."""

    estimate: FloatArray
    """(m, q)."""
    covariance: FloatArray
    """(m, m) for unit variance of the whitened noise; zero for what is held."""
    chi_square: FloatArray
    """(q,) sum of squared whitened residuals."""
    degrees: int
    """Rows minus unknowns that were determined."""
    held: dict[int, dict[int, float]]
    """Unknowns that the data cannot determine: each with the earlier unknowns whose columns make
    up its own and in what proportion; with none where its column is zero."""


def solve(equations: NormalEquations) -> Solution:
    """Return the least-squares solution by a Cholesky factor grown column by column."""
    scale = np.sqrt(np.maximum(np.diag(equations.gram), 0.0))
    usable = scale > 0.0
    unit = np.where(usable, scale, 1.0)
    gram = equations.gram / np.outer(unit, unit)
    kept, factor, held = _independent(gram, usable)
    m = len(scale)
    estimate = np.zeros((m, equations.moment.shape[1]))
    covariance = np.zeros((m, m))
    lower = factor[: len(kept), : len(kept)]
    half = solve_triangular(lower, equations.moment[kept] / unit[kept, None], lower=True)
    estimate[kept] = solve_triangular(lower.T, half) / unit[kept, None]
    inverse = solve_triangular(lower, np.eye(len(kept)), lower=True)
    covariance[np.ix_(kept, kept)] = inverse.T @ inverse / np.outer(unit[kept], unit[kept])
    return Solution(
        estimate=estimate,
        covariance=covariance,
        chi_square=np.maximum(equations.energy - (half**2).sum(axis=0), 0.0),
        degrees=max(equations.rows - len(kept), 1),
        held=held,
    )


def _independent(
    gram: FloatArray, usable: NDArray[np.bool_]
) -> tuple[IntArray, FloatArray, dict[int, dict[int, float]]]:
    """Return the columns that each bring something new, their lower factor, and the others."""
    m = len(gram)
    factor = np.zeros((m, m))
    kept: list[int] = []
    held: dict[int, dict[int, float]] = {}
    for j in range(m):
        if not usable[j]:
            held[j] = {}
            continue
        k = len(kept)
        row = solve_triangular(factor[:k, :k], gram[kept, j], lower=True) if k else np.zeros(0)
        pivot = gram[j, j] - row @ row
        if pivot > DEPENDENT:
            factor[k, :k] = row
            factor[k, k] = np.sqrt(pivot)
            kept.append(j)
        else:
            share = solve_triangular(factor[:k, :k].T, row)
            held[j] = {i: float(c) for i, c in zip(kept, share, strict=True) if abs(c) > 1e-3}
    return np.asarray(kept, dtype=np.int64), factor, held
