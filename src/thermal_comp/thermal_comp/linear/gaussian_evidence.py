# SPDX-License-Identifier: Apache-2.0
"""Marginal likelihood of whitened rows under columns with Gaussian coefficients.

With whitened columns X of unit length, coefficients c ~ N(0, σ² Λ) and noise e ~ N(0, σ² I), rows
r = X c + e have, with an inverse-gamma prior of σ² about one worth ν rows, the evidence

    ln p(r) = −½ ln |I + Λ XᵀX| − ½ (n + ν) ln ((ν + χ²) / (n + ν)),
    χ² = rᵀr − (Xᵀr)ᵀ (Λ⁻¹ + XᵀX)⁻¹ Xᵀr

up to a constant (MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 28).
Nothing but the normal matrix XᵀX and Xᵀr of a design enters: columns are integrated out one group
after the other, and many forms of an effect are compared by small eigenproblems.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray, IntArray

NOISE_ROWS = 10.0
"""Rows the prior of the noise level is worth: an error of its estimate by a third is usual."""


@dataclass(frozen=True, eq=False)
class CoefficientPrior:
    """Columns of a design with the Gaussian prior of their coefficients, σ = 1."""

    columns: tuple[int, ...]
    shared: bool
    """True where the three axes share the coefficients; else each axis has its own."""
    deviation: FloatArray
    """(p,) prior standard deviation of the coefficients of columns of unit length."""


@dataclass(frozen=True, eq=False)
class ConditionedDesign:
    """Normal equations of one sensor's columns, some of them integrated out."""

    normal: FloatArray
    """(3, c, c)."""
    right: FloatArray
    """(3, c)."""
    chi_square: float
    log_determinant: float
    """ln |I + Λ XᵀX| of what was integrated out."""
    rows: int
    """Rows of the three axes together, less the rank of the base model."""
    coupling: FloatArray
    """(k, 3, c) H: products between columns of axes a and b are less by H_aᵀ H_b, because k
    coefficients that the axes share were integrated out."""

    @property
    def log_evidence(self) -> float:
        """Evidence of what was integrated out so far."""
        return float(log_evidence(self.chi_square, self.log_determinant, self.rows))

    def evidences(
        self, columns: IntArray, deviations: FloatArray, *, shared: bool, beside: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Return (f, s) ln evidence and Δχ² of f forms of p columns (f, p) at s prior widths.

        Widths are those of coefficients of columns of unit length; `beside`: those of all that a
        form adds, √Δχ², to what was integrated out.
        """
        forms = len(columns)
        blocks = self.normal[:, columns[:, :, None], columns[:, None, :]]
        right = self.right[:, columns]
        half = self.coupling[:, :, columns].transpose(1, 2, 0, 3)
        if shared:
            blocks, right, half = (x.sum(axis=0, keepdims=True) for x in (blocks, right, half))
        if len(blocks) * columns.shape[1] <= half.shape[2]:
            blocks, right, half = _as_one_axis(blocks, right, half)
        # Blocks of axes are diagonalised by themselves; what couples them has a low rank.
        values, vectors = np.linalg.eigh(blocks)
        values = np.maximum(values.transpose(1, 2, 0).reshape(forms, -1), 0.0)
        right = np.einsum('afij,afi->fja', vectors, right).reshape(values.shape)
        half = np.einsum('afij,afki->fkja', vectors, half)
        half = half.reshape(forms, half.shape[1], values.shape[1])
        left = np.maximum(values.sum(axis=1) - (half**2).sum(axis=(1, 2)), 1e-6)
        variance = deviations**2 / (left if beside else np.ones(forms))[:, None]
        inverse = 1.0 / (values[:, None] + 1.0 / variance[:, :, None])
        weighted = half[:, None] * inverse[:, :, None, :]
        inner = np.eye(half.shape[1]) - weighted @ half.transpose(0, 2, 1)[:, None]
        across = weighted @ right[:, None, :, None]
        gain: FloatArray = (right[:, None] ** 2 * inverse).sum(axis=2)
        gain += (across * np.linalg.solve(inner, across)).sum(axis=(2, 3))
        determinant = np.log1p(variance[:, :, None] * values[:, None]).sum(axis=2)
        determinant += np.linalg.slogdet(inner)[1]
        evidence = log_evidence(
            self.chi_square - gain, self.log_determinant + determinant, self.rows
        )
        return np.asarray(evidence), gain


def _as_one_axis(
    blocks: FloatArray, right: FloatArray, half: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return blocks (a, f, p, p) and what couples them, (a, f, k, p), as one block (1, f, ap, ap).

    It pays where few columns are coupled by many coefficients.
    """
    axes, forms, columns = right.shape
    size = axes * columns
    across = half.transpose(1, 2, 0, 3).reshape(forms, -1, size)
    whole = -across.transpose(0, 2, 1) @ across
    for axis in range(axes):
        own = slice(axis * columns, (axis + 1) * columns)
        whole[:, own, own] += blocks[axis]
    together = right.transpose(1, 0, 2).reshape(1, forms, size)
    return whole[None], together, np.zeros((1, forms, 0, size))


def conditioned(
    normal: FloatArray,
    right: FloatArray,
    chi_square: float,
    rows: int,
    priors: Sequence[CoefficientPrior],
) -> ConditionedDesign:
    """Return the equations (3, c, c) and (3, c) with columns integrated out.

    First those whose coefficients each axis has for itself, then those the axes share.
    """
    index, deviation = _joined([p for p in priors if not p.shared])
    normal, right, determinant = normal.copy(), right.copy(), 0.0
    for axis in range(3):
        cross = normal[axis][index] * deviation[:, None]
        lower = np.linalg.cholesky(np.eye(len(index)) + cross[:, index] * deviation)
        half = np.linalg.solve(lower, np.column_stack([cross, right[axis][index] * deviation]))
        normal[axis] -= half[:, :-1].T @ half[:, :-1]
        right[axis] -= half[:, :-1].T @ half[:, -1]
        chi_square -= float(half[:, -1] @ half[:, -1])
        determinant += 2.0 * float(np.log(np.diag(lower)).sum())
    index, deviation = _joined([p for p in priors if p.shared])
    crosses = normal[:, index] * deviation[:, None]
    lower = np.linalg.cholesky(np.eye(len(index)) + crosses.sum(axis=0)[:, index] * deviation)
    coupling = np.linalg.solve(lower, crosses).transpose(1, 0, 2)
    answer = np.linalg.solve(lower, right.sum(axis=0)[index] * deviation)
    right = right - np.einsum('kac,k->ac', coupling, answer)
    chi_square -= float(answer @ answer)
    determinant += 2.0 * float(np.log(np.diag(lower)).sum())
    return ConditionedDesign(normal, right, chi_square, determinant, rows, coupling)


def _joined(priors: Sequence[CoefficientPrior]) -> tuple[list[int], FloatArray]:
    """Return the columns of several priors and their standard deviations."""
    columns = [c for prior in priors for c in prior.columns]
    return columns, np.concatenate([np.zeros(0), *(prior.deviation for prior in priors)])


def log_evidence(
    chi_square: FloatArray | float, log_determinant: FloatArray | float, rows: int
) -> FloatArray | float:
    """Return ln p(r) up to the constant that all hypotheses share."""
    total = rows + NOISE_ROWS
    left = np.maximum(chi_square, 0.0) + NOISE_ROWS
    answer: FloatArray | float = -0.5 * log_determinant - 0.5 * total * np.log(left / total)
    return answer


def joint_evidence(
    normal: FloatArray,
    right: FloatArray,
    chi_square: float,
    rows: int,
    priors: Sequence[CoefficientPrior],
) -> tuple[float, float]:
    """Return ln evidence and Δχ² of columns together, those that the axes share as one."""
    own = [
        (c, s) for p in priors if not p.shared for c, s in zip(p.columns, p.deviation, strict=True)
    ]
    common = [
        (c, s) for p in priors if p.shared for c, s in zip(p.columns, p.deviation, strict=True)
    ]
    index, deviation = [c for c, _ in own], np.array([s for _, s in own])
    index_common, deviation_common = [c for c, _ in common], np.array([s for _, s in common])
    shared_normal, shared_right = np.eye(len(common)), np.zeros(len(common))
    left, determinant = chi_square, 0.0
    for axis in range(3):
        block, rows_right = normal[axis], right[axis]
        between = block[np.ix_(index, index_common)] * np.outer(deviation, deviation_common)
        if own:
            inner = block[np.ix_(index, index)] * np.outer(deviation, deviation)
            lower = np.linalg.cholesky(np.eye(len(own)) + inner)
            half = np.linalg.solve(
                lower, np.column_stack([rows_right[index] * deviation, between])
            )
            left -= float(half[:, 0] @ half[:, 0])
            determinant += 2.0 * float(np.log(np.diag(lower)).sum())
            shared_normal -= half[:, 1:].T @ half[:, 1:]
            shared_right -= half[:, 1:].T @ half[:, 0]
        shared_normal += block[np.ix_(index_common, index_common)] * np.outer(
            deviation_common, deviation_common
        )
        shared_right += rows_right[index_common] * deviation_common
    if common:
        lower = np.linalg.cholesky(shared_normal)
        half_shared = np.linalg.solve(lower, shared_right)
        left -= float(half_shared @ half_shared)
        determinant += 2.0 * float(np.log(np.diag(lower)).sum())
    return float(log_evidence(left, determinant, rows)), chi_square - left


def log_sum(values: FloatArray | Sequence[float]) -> float:
    """Return ln Σ exp(values)."""
    return float(np.logaddexp.reduce(np.asarray(values, dtype=np.float64)))
