# SPDX-License-Identifier: Apache-2.0
"""Do the axes of a sensor share a course that sensor noise cannot have in common?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.diagnose_bank import ColumnBank, Term

WAVES = 48
"""Half waves over a run that are looked at."""
SPANS = (4, 8, 16, 32, 48)
"""Numbers of the slowest of them that are taken together."""
ABSORBED = 1e-9
"""A half wave of which less than this share of its power is left beside the base says nothing."""


@dataclass(frozen=True)
class Coherence:
    """What speaks for a common course; 2 ln of the Bayes factor, about −5 for noise alone."""

    axes: float
    """The axes share it."""
    runs: float
    """The runs share it too, at the same time since their beginning."""

    @property
    def evidence(self) -> float:
        """Both together."""
        return self.axes + max(self.runs, 0.0)


def coherence(bank: ColumnBank, found: Sequence[Term] = ()) -> Coherence:
    """Return the evidence for a course common to the axes in what the found effects leave.

    A course over time hides in a noise model that is rich enough to follow it, but noise is
    independent between axes and between runs. The slow half waves of each run, whitened and made
    orthogonal, are compared: −(n − 1 − (2 p + 5) / 6) ln det R − p (p − 1) / 2 · ln n, where R
    (p, p) correlates n waves of p axes, or of p runs along the axes' common direction (Bartlett's
    test of independence). The strongest over the SPANS counts.
    """
    waves = _waves(bank, found)
    axes = runs = -np.inf
    for span in SPANS:
        part = waves[:, :, :span]
        rows = part.reshape(len(part), -1)
        axes = max(axes, _dependence(rows))
        direction = np.linalg.eigh(rows @ rows.T)[1][:, -1]
        runs = max(runs, _dependence(np.einsum('a,ark->rk', direction, part)))
    return Coherence(float(axes), float(runs))


def _waves(bank: ColumnBank, found: Sequence[Term]) -> FloatArray:
    """(3, runs, WAVES) amplitudes of the half waves, of unit variance for noise alone.

    With V the whitened half waves of a run, Q the base and r the residual, they are R⁻ᵀ Vᵀ r,
    Rᵀ R = Vᵀ V − (Qᵀ V)ᵀ Qᵀ V (Cholesky): as if V were made orthogonal to Q, then in itself.
    """
    runs = bank.source.runs
    longest = max(float(run.time[-1]) for run in runs)
    known = bank.design(list(found))
    amplitudes = np.empty((3, len(runs), WAVES))
    for axis in range(3):
        target = bank.target[axis]
        if found:
            target = target - known[axis] @ np.linalg.lstsq(known[axis], target, rcond=1e-9)[0]
        for number, run in enumerate(runs):
            half_turns = np.multiply.outer(run.time / longest, np.arange(1, WAVES + 1))
            white, rows = bank.whitened_in_run(np.cos(np.pi * half_turns), number, axis)
            cross = bank.base[axis][rows].T @ white
            normal = white.T @ white
            normal -= cross.T @ cross - ABSORBED * np.diag(np.diag(normal))
            triangle = np.linalg.cholesky(normal)
            amplitudes[axis, number] = np.linalg.solve(triangle, white.T @ target[rows])
    return amplitudes


def _dependence(rows: FloatArray) -> float:
    """Return the evidence that the (p, n) rows depend on each other."""
    p, n = rows.shape
    power = (rows**2).sum(axis=1)
    if p < 2 or n < p + 1 or not (power > 0.0).all():
        return -np.inf
    correlation = rows @ rows.T / np.sqrt(np.outer(power, power))
    determinant = max(float(np.linalg.det(correlation)), 1e-300)
    weight = n - 1.0 - (2.0 * p + 5.0) / 6.0
    price = 0.5 * p * (p - 1) * float(np.log(n))
    return float(-weight * np.log(determinant) - price)
