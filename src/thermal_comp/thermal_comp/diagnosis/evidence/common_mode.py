# SPDX-License-Identifier: Apache-2.0
"""A course over time that the runs repeat from their start: evidence that there is one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.linear.candidate_design import CandidateDesign, ColumnGroup
from thermal_comp.linear.columns import LEAST_NEW_POWER

HALF_WAVES = 48
"""Number of half waves over a run that are compared."""
HALF_WAVE_COUNTS = (4, 8, 16, 32, 48)
"""Numbers of the slowest of them that are taken together."""


def runs_in_step(design: CandidateDesign, found: Sequence[ColumnGroup] = ()) -> float:
    """Return the evidence for a course over time that runs share in what effects found leave.

    2 ln of the Bayes factor. A course over time hides in a noise model
    that is rich enough to follow it, but noise is independent between runs. The slow half waves
    of each run, whitened and made orthogonal, are compared:
    −(n − 1 − (2 p + 5) / 6) ln det R − p (p − 1) / 2 · ln n, where R (p, p) correlates n waves of
    p runs along the direction that their axes have in common (Bartlett's test of independence).
    The strongest of HALF_WAVE_COUNTS counts.
    """
    waves = _waves(design, found)
    evidence = -np.inf
    for span in HALF_WAVE_COUNTS:
        part = waves[:, :, :span]
        rows = part.reshape(len(part), -1)
        direction = np.linalg.eigh(rows @ rows.T)[1][:, -1]
        evidence = max(evidence, _shared_evidence(np.einsum('a,ark->rk', direction, part)))
    return float(evidence)


def _waves(design: CandidateDesign, found: Sequence[ColumnGroup]) -> FloatArray:
    """(3, runs, HALF_WAVES) amplitudes of the half waves, of unit variance for noise alone.

    With V the whitened half waves of a run, Q the base and r the residual, they are R⁻ᵀ Vᵀ r,
    Rᵀ R = Vᵀ V − (Qᵀ V)ᵀ Qᵀ V (Cholesky): as if V were made orthogonal to Q, then in itself.
    """
    runs = design.source.runs
    longest = max(float(run.time[-1]) for run in runs)
    left = design.residual(found)
    amplitudes = np.empty((3, len(runs), HALF_WAVES))
    for axis in range(3):
        target = left[axis]
        for number, run in enumerate(runs):
            half_turns = np.multiply.outer(run.time / longest, np.arange(1, HALF_WAVES + 1))
            white, rows = design.whitened_in_run(np.cos(np.pi * half_turns), number, axis)
            cross = design.base[axis][rows].T @ white
            normal = white.T @ white
            normal -= cross.T @ cross - LEAST_NEW_POWER * np.diag(np.diag(normal))
            triangle = np.linalg.cholesky(normal)
            amplitudes[axis, number] = np.linalg.solve(triangle, white.T @ target[rows])
    return amplitudes


def _shared_evidence(rows: FloatArray) -> float:
    """Return the evidence that the (p, n) rows depend on each other."""
    p, n = rows.shape
    power = (rows**2).sum(axis=1)
    if p < 2 or n < p + 1 or not (power > 0.0).all():
        return -np.inf
    correlation = rows @ rows.T / np.sqrt(np.outer(power, power))
    determinant = max(float(np.linalg.det(correlation)), 1e-300)
    weight = n - 1.0 - (2.0 * p + 5.0) / 6.0
    bic_penalty = 0.5 * p * (p - 1) * float(np.log(n))
    return float(-weight * np.log(determinant) - bic_penalty)
