# SPDX-License-Identifier: Apache-2.0
"""Normal equations, accumulated piece by piece, and their solution with rank and names."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.effect import Effect, State
from thermal_comp.linear.columns import LEAST_NEW_POWER
from thermal_comp.model.values import ModelError


def pseudo_solve(
    normal: FloatArray, right: FloatArray, full: FloatArray | None = None
) -> tuple[FloatArray, int]:
    """Return the minimum-norm solution and the rank; undetermined directions stay zero.

    `full`: squares of the columns before others were taken out, if any were.
    """
    if not len(normal):
        return np.zeros((0, right.shape[1])), 0
    size = np.sqrt(np.maximum(np.diag(normal) if full is None else full, 0.0))
    inverse = np.where(size > 0.0, 1.0 / np.maximum(size, 1e-300), 0.0)
    scaled = normal * inverse[:, None] * inverse[None, :]
    values, vectors = np.linalg.eigh(scaled)
    kept: NDArray[np.bool_] = values > LEAST_NEW_POWER
    vectors = vectors[:, kept]
    turned = vectors.T @ (right * inverse[:, None])
    answer = inverse[:, None] * (vectors @ (turned / values[kept][:, None]))
    return answer, int(kept.sum())


def taken_out(
    products: FloatArray, known: IntArray, full: FloatArray | None = None
) -> tuple[FloatArray, int]:
    """Return products (q, q) with some columns taken out of all, and the rank of those.

    The target may be one of the columns: what is then less of its square is the χ² explained.
    """
    answer, rank = pseudo_solve(products[np.ix_(known, known)], products[known], full)
    left: FloatArray = products - products[:, known] @ answer
    return left, rank


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
    response: FloatArray
    """(m, m) of the estimate to XᵀY: the covariance, where the weights are those of the noise."""
    chi_square: FloatArray
    """(q,) sum of squared whitened residuals."""
    degrees: int
    """Rows minus unknowns that were determined."""
    held: dict[int, dict[int, float]]
    """Unknowns that the data cannot determine: each with the earlier unknowns whose columns make
    up its own and in what proportion; with none where its column is zero."""


@dataclass(frozen=True, eq=False)
class Factor:
    """Cholesky factor of a normal matrix, grown column by column."""

    kept: IntArray
    """(k,) columns that each bring something new."""
    unit: FloatArray
    """(m,) length of the columns."""
    lower: FloatArray
    """(k, k) of kept columns of unit length."""
    held: dict[int, dict[int, float]]
    """As of `Solution`."""

    def half(self, right: FloatArray) -> FloatArray:
        """Return (k, q) L⁻¹ of right-hand sides (m, q)."""
        scaled = right[self.kept] / self.unit[self.kept, None]
        return np.asarray(solve_triangular(self.lower, scaled, lower=True))


def factor(gram: FloatArray, power: FloatArray | None = None) -> Factor:
    """Return the factor of XᵀX (m, m).

    `power` (m,): squares of the columns before others were taken out; what is less than
    LEAST_NEW_POWER of it is nothing new.
    """
    scale = np.sqrt(np.maximum(np.diag(gram) if power is None else power, 0.0))
    usable = scale > 0.0
    unit = np.where(usable, scale, 1.0)
    kept, lower, held = _independent(gram / np.outer(unit, unit), usable)
    return Factor(kept, unit, lower[: len(kept), : len(kept)], held)


def solve(equations: NormalEquations) -> Solution:
    """Return the least-squares solution by a Cholesky factor grown column by column."""
    known = factor(equations.gram)
    kept, unit, lower = known.kept, known.unit, known.lower
    m = len(unit)
    estimate = np.zeros((m, equations.moment.shape[1]))
    covariance = np.zeros((m, m))
    half = known.half(equations.moment)
    estimate[kept] = solve_triangular(lower.T, half) / unit[kept, None]
    inverse = solve_triangular(lower, np.eye(len(kept)), lower=True)
    covariance[np.ix_(kept, kept)] = inverse.T @ inverse / np.outer(unit[kept], unit[kept])
    return Solution(
        estimate=estimate,
        covariance=covariance,
        response=covariance,
        chi_square=np.maximum(equations.energy - (half**2).sum(axis=0), 0.0),
        degrees=max(equations.rows - len(kept), 1),
        held=known.held,
    )


def _independent(
    gram: FloatArray, usable: NDArray[np.bool_]
) -> tuple[IntArray, FloatArray, dict[int, dict[int, float]]]:
    """Return the columns that each bring something new, their lower factor, and the others."""
    m = len(gram)
    if usable.all():
        with suppress(np.linalg.LinAlgError):
            factor = np.linalg.cholesky(gram)
            if (np.diag(factor) ** 2 > LEAST_NEW_POWER).all():
                return np.arange(m), factor, {}
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
        if pivot > LEAST_NEW_POWER:
            factor[k, :k] = row
            factor[k, k] = np.sqrt(pivot)
            kept.append(j)
        else:
            share = solve_triangular(factor[:k, :k].T, row)
            held[j] = {i: float(c) for i, c in zip(kept, share, strict=True) if abs(c) > 1e-3}
    return np.asarray(kept, dtype=np.int64), factor, held


SAMPLES_AT_A_TIME = 16_384
"""Samples taken at a time; columns of a piece stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class Gram:
    """Sums of products of 1, p columns and q measured values over n samples of one run."""

    products: FloatArray
    """(1 + p + q, 1 + p + q)."""
    measured: int
    """q."""

    def equations(self) -> NormalEquations:
        """Return the normal equations with the run's level taken out."""
        n = self.products[0, 0]
        sums = self.products[0, 1:]
        centred = self.products[1:, 1:] - np.outer(sums, sums) / n
        p = len(centred) - self.measured
        return NormalEquations(
            gram=centred[:p, :p],
            moment=centred[:p, p:],
            energy=np.diag(centred)[p:],
            rows=int(n) - 1,
        )


def gram(
    effects: Sequence[Effect], conditions: Conditions, measured: Sequence[FloatArray]
) -> Gram:
    """Return the products of the effects' columns (n, p) and the measured arrays (n, 3).

    All sensors share the columns, so the effects must not look at the sensor, and their
    coefficients are per axis. Rows in which anything is not finite do not count. History effects
    carry their state from piece to piece.
    """
    q = sum(values.shape[1] for values in measured)
    total = np.zeros((0, 0))
    states: list[State | None] = [None] * len(effects)
    # A level the run's own takes up anyway: without it small residuals drown in large sums.
    medians = [np.nanmedian(values[:SAMPLES_AT_A_TIME], axis=0) for values in measured]
    shift = np.nan_to_num(np.concatenate(medians))[:, None]
    for start in range(0, len(conditions), SAMPLES_AT_A_TIME):
        rows = slice(start, start + SAMPLES_AT_A_TIME)
        part = conditions.rows(rows)
        stacked = [np.ones((len(part), 1))]
        for k, effect in enumerate(effects):
            columns, states[k] = effect.columns(part, states[k])
            if columns.ndim == 3:
                raise ModelError(
                    f'{effect.name}: its axes share coefficients; fit it to block means'
                )
            stacked.append(columns)
        stacked += [values[rows] for values in measured]
        # Columns lie contiguously, as the product reads them.
        block = np.empty((sum(c.shape[1] for c in stacked), len(part)))
        np.concatenate([c.T for c in stacked], out=block)
        block[-q:] -= shift
        products = block @ block.T
        if not np.isfinite(products[0]).all():
            block = block[:, np.isfinite(block).all(axis=0)]
            products = block @ block.T
        total = products if not total.size else total + products
    return Gram(total, q)
