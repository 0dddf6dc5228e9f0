# SPDX-License-Identifier: Apache-2.0
"""Curve and levels of stretches at rest, solved together.

The level ℓ of a stretch (its mean output at the reference temperature) is not free, as in a run
of a chamber campaign, but the sum of a part common to all logs, a change u by every power-on, and
a part v of the pose:

    U ℓ − t = H γ + u_log + v_stretch,   u ~ N(0, σ_u² R),  v ~ N(0, σ_v² + floor)

For a gyroscope U is the identity, t zero, γ the device's zero-rate level, and the floor Earth's
rate in an unknown direction. Of an accelerometer in an unknown pose only the norm is known: U is
the direction of gravity û in each stretch and t gravity itself, so that across it a stretch shows
only its change with temperature. û is the direction of the measurement less the known error: an
error e across gravity lengthens the mean by e²/2g, which changes over temperature by many mm/s²
(`pool.py`). The slope over temperature of a single stretch may differ from the curve's by
N(0, σ_s²), as other parts warm up with it. σ_u, σ_v, σ_s and the size of the curve's bends are
those of the largest marginal likelihood over γ and the coefficients
(restricted maximum likelihood: Patterson and Thompson, Biometrika 58, 1971; the bends as Rasmussen
and Williams, Gaussian Processes for Machine Learning, 2006, ch. 2.7).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize

LOG_SIGMA_STD = 2.0
"""Standard deviation of ln σ about its usual value before the logs are seen."""
LEAST_PRECISION = 1e-12
"""Relative precision that is added for a factorisation, too small to change the solution."""
LARGEST_LOG_SIGMA = 14.0
"""Greatest |ln σ| of the search, about its usual value."""


@dataclass(frozen=True, eq=False)
class LevelEquations:
    """Normal equations of stretches, and equations of their levels; l levels, p coefficients.

    Unknowns are the levels, then the coefficients.
    """

    gram: FloatArray
    """(l + p, l + p) of whitened rows."""
    moment: FloatArray
    """(l + p,)."""
    seen: FloatArray
    """(k, l) U."""
    target: FloatArray
    """(k,) t [unit]."""
    common: FloatArray
    """(k, q) H."""
    common_std: FloatArray
    """(q,) prior standard deviation of γ; infinite for none."""
    same_log: FloatArray
    """(k, k) R: correlation of the changes by power-on."""
    floor: FloatArray
    """(k,) least variance of each level [unit²]."""
    fixed: FloatArray
    """(p,) prior standard deviation of each coefficient; infinite for none."""
    bending: FloatArray
    """(p,) prior standard deviation of those that are bends, for bends of size 1."""
    slopes: NDArray[np.bool_]
    """(p,) whether a coefficient is the slope of a single stretch about the curve's."""
    usual: FloatArray
    """(4,) usual σ_u, σ_v, size of the bends [unit], and σ of the slopes [unit/K]."""


@dataclass(frozen=True, eq=False)
class LevelSolution:
    """Unknowns with their covariance: levels, coefficients, γ."""

    estimate: FloatArray
    covariance: FloatArray
    sigma: FloatArray
    """(4,) σ_u, σ_v, size of the bends [unit], and σ of the slopes [unit/K]."""
    log_evidence: float
    """ln of the marginal likelihood and of the variances' prior, up to a constant of the rows."""
    apart: FloatArray
    """(k,) distance of each level from its prediction by the others, in standard deviations."""


def solve_levels(equations: LevelEquations, sigma: FloatArray | None = None) -> LevelSolution:
    """Return the solution; `sigma` (4,) keeps variances that are known."""
    if sigma is None:
        start = np.zeros(4)
        found = minimize(
            partial(_minus_log_posterior, equations),
            start,
            method='Nelder-Mead',
            options={'xatol': 0.1, 'fatol': 0.05, 'initial_simplex': _simplex()},
        )
        sigma = equations.usual * np.exp(np.clip(found.x, -LARGEST_LOG_SIGMA, LARGEST_LOG_SIGMA))
    precision, moment = _posterior(equations, sigma)[:2]
    size = 1.0 / np.sqrt(np.diag(precision))
    root = cholesky(precision * np.outer(size, size), lower=True)
    covariance = size[:, None] * cho_solve((root, True), np.eye(len(size))) * size
    estimate = covariance @ moment
    return LevelSolution(
        estimate=estimate,
        covariance=covariance,
        sigma=sigma,
        log_evidence=_log_posterior(equations, np.log(sigma / equations.usual)),
        apart=_left_out_residuals(equations, sigma, estimate),
    )


def _minus_log_posterior(equations: LevelEquations, x: FloatArray) -> float:
    return -_log_posterior(equations, x)


def _simplex() -> FloatArray:
    """Return (5, 4) first points of the search for ln σ."""
    return np.concatenate([np.zeros((1, 4)), 1.5 * np.eye(4)])


def _log_posterior(equations: LevelEquations, x: FloatArray) -> float:
    """Return ln of the marginal likelihood and of the prior of the variances, up to a constant."""
    if np.abs(x).max() > LARGEST_LOG_SIGMA:
        return -np.inf
    precision, moment, weight, energy = _posterior(equations, equations.usual * np.exp(x))
    size = 1.0 / np.sqrt(np.diag(precision))
    root = cholesky(precision * np.outer(size, size), lower=True)
    half = solve_triangular(root, size * moment, lower=True)
    bends = int(np.isfinite(equations.bending).sum())
    fixed = equations.fixed[np.isfinite(equations.fixed)]
    value = 0.5 * (half @ half - energy) - np.log(np.diag(root) / size).sum()
    value += 0.5 * np.linalg.slogdet(weight)[1] - bends * x[2] - np.log(fixed).sum()
    value -= equations.slopes.sum() * x[3]
    return float(value - 0.5 * (x @ x) / LOG_SIGMA_STD**2)


def _posterior(
    equations: LevelEquations, sigma: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return precision and moment of all unknowns, weight of levels, energy of their target."""
    e = equations
    inside, q = len(e.moment), e.common.shape[1]
    spread = sigma[0] ** 2 * e.same_log + np.diag(sigma[1] ** 2 + e.floor)
    weight = cho_solve((cholesky(spread, lower=True), True), np.eye(len(spread)))
    columns = np.zeros((len(e.target), inside + q))
    columns[:, : e.seen.shape[1]] = e.seen
    columns[:, inside:] = -e.common
    precision = columns.T @ weight @ columns
    precision[:inside, :inside] += e.gram
    prior = np.concatenate([
        np.zeros(e.seen.shape[1]),
        (sigma[2] * e.bending) ** -2.0 + e.fixed**-2.0 + e.slopes * sigma[3] ** -2.0,
        e.common_std**-2.0,
    ])  # fmt: skip
    diagonal = np.diag_indices(len(precision))
    precision[diagonal] = precision[diagonal] * (1.0 + LEAST_PRECISION) + prior
    moment = columns.T @ (weight @ e.target)
    moment[:inside] += e.moment
    return precision, moment, weight, float(e.target @ weight @ e.target)


def _left_out_residuals(
    equations: LevelEquations, sigma: FloatArray, estimate: FloatArray
) -> FloatArray:
    """Return (k,) leave-one-out residuals of the levels in their standard deviations."""
    e = equations
    levels, common = estimate[: e.seen.shape[1]], estimate[len(e.moment) :]
    weight = np.linalg.inv(sigma[0] ** 2 * e.same_log + np.diag(sigma[1] ** 2 + e.floor))
    left = e.seen @ levels - e.target - e.common @ common
    apart: FloatArray = np.abs(weight @ left) / np.sqrt(np.diag(weight))
    return apart
