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

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np
from imu_recording.jit import inline, njit
from imu_recording.recording import FloatArray, IntArray

LEAST_LEFT_POWER = 1e-6
"""Least that columns of unit length are taken to have left beside others: it is divided by."""
LEAST_PIVOT = 1e-12
"""Least pivot of what is left of positive definite equations; rounding errors are less."""
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
    """(3, c, c) before; of columns that are not integrated out, those of one form are enough."""
    half: FloatArray
    """(3, k, c) H: products between columns of one axis are less by HᵀH, because k coefficients
    that each axis has for itself were integrated out."""
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
    _diagonal: dict[Hashable, tuple[FloatArray, FloatArray, FloatArray]] = field(
        default_factory=dict
    )
    """Columns → what `_diagonalised` made of them: flaws and laws ask for the same ones."""

    @property
    def log_evidence(self) -> float:
        """Evidence of what was integrated out so far."""
        return float(log_evidence(self.chi_square, self.log_determinant, self.rows))

    def blocks(self, columns: IntArray) -> FloatArray:
        """Return (3, f, p, p) the products that f forms of p columns (f, p) have left."""
        half = self.half[:, :, columns].transpose(0, 2, 3, 1)
        before = self.normal[:, columns[:, :, None], columns[:, None, :]]
        return np.asarray(before - half @ half.transpose(0, 1, 3, 2))

    def power(self, columns: Sequence[int]) -> float:
        """Return what the squares of columns have left over the axes."""
        index = list(columns)
        left = float(np.trace(self.blocks(np.array([index]))[:, 0], axis1=1, axis2=2).sum())
        return max(left - float((self.coupling[:, :, index] ** 2).sum()), LEAST_LEFT_POWER)

    def shared_equations(self, columns: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Return the equations (p, p) and (p,) of coefficients that the axes share."""
        index = list(columns)
        half = self.coupling[:, :, index].sum(axis=1)
        normal = self.blocks(np.array([index])).sum(axis=(0, 1)) - half.T @ half
        return normal, self.right[:, index].sum(axis=0)

    def evidences(
        self,
        columns: IntArray,
        deviations: FloatArray,
        *,
        shared: bool,
        beside: bool = False,
        relative: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return (f, s) ln evidence and Δχ² of f forms of p columns (f, p) at s prior widths.

        Widths are those of coefficients of columns of unit length, each times `relative` (f, p)
        where given; `beside`: those of all that a form adds, √Δχ², to what was integrated out.
        """
        key = columns.shape, columns.tobytes(), shared
        if relative is not None:
            values, right, half = self._diagonalised(columns, shared, relative)
        else:
            if key not in self._diagonal:
                self._diagonal[key] = self._diagonalised(columns, shared)
            values, right, half = self._diagonal[key]
        left = np.maximum(values.sum(axis=1) - (half**2).sum(axis=(1, 2)), LEAST_LEFT_POWER)
        variance = deviations**2 / (left if beside else np.ones(len(columns)))[:, None]
        determinant, delta_chi2 = _weigh(values, right, half, variance)
        evidence = log_evidence(
            self.chi_square - delta_chi2, self.log_determinant + determinant, self.rows
        )
        return np.asarray(evidence), delta_chi2

    def _diagonalised(
        self, columns: IntArray, shared: bool, relative: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return eigenvalues (f, q) of forms' products, (f, q) right-hand sides, (f, q, k) half.

        What couples axes, or a form's columns to coefficients that axes share, stays in `half`
        where those are fewer than the form's own; else all its products are diagonalised.
        """
        forms = len(columns)
        blocks, right = self.blocks(columns), self.right[:, columns]
        half = self.coupling[:, :, columns].transpose(1, 2, 0, 3)
        if relative is not None:
            blocks = blocks * relative[:, :, None] * relative[:, None, :]
            right, half = right * relative, half * relative[:, None, :]
        if shared:
            blocks, right, half = (x.sum(axis=0, keepdims=True) for x in (blocks, right, half))
        if 0 < right.shape[0] * right.shape[2] <= half.shape[2]:
            blocks, right, half = _whole(blocks, right, half)
        # Blocks of axes are diagonalised by themselves; what couples them has a low rank.
        values, vectors = _eigen(blocks)
        values = np.maximum(values.transpose(1, 0, 2), 0.0, order='C').reshape(forms, -1)
        right = np.einsum('afij,afi->faj', vectors, right, order='C').reshape(values.shape)
        half = np.einsum('afij,afki->fajk', vectors, half, order='C')
        half = half.reshape(*values.shape, half.shape[3])
        return values, right, half


def _whole(
    blocks: FloatArray, right: FloatArray, half: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return blocks (a, f, p, p), right (a, f, p), half (a, f, k, p) as one block, k taken out."""
    axes, forms, size = right.shape
    joined = half.transpose(1, 0, 3, 2).reshape(forms, axes * size, -1)
    left = -joined @ joined.transpose(0, 2, 1)
    for axis in range(axes):
        own = slice(axis * size, (axis + 1) * size)
        left[:, own, own] += blocks[axis]
    whole = right.transpose(1, 0, 2).reshape(1, forms, axes * size)
    return left[None], whole, np.zeros((1, forms, 0, axes * size))


def _eigen(blocks: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues and eigenvectors of symmetric blocks (a, f, p, p)."""
    if blocks.shape[-1] == 1:
        return blocks[..., 0], np.ones_like(blocks)
    values, vectors = np.linalg.eigh(blocks)
    return values, vectors


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
    common, deviation_common = _joined([p for p in priors if p.shared])
    right, determinant = right.copy(), 0.0
    halves = np.empty((3, len(index), right.shape[1]))
    crosses = np.empty((3, len(common), right.shape[1]))
    for axis in range(3):
        cross = normal[axis][index] * deviation[:, None]
        lower = np.linalg.cholesky(np.eye(len(index)) + cross[:, index] * deviation)
        half = np.linalg.solve(lower, np.column_stack([cross, right[axis][index] * deviation]))
        halves[axis] = half[:, :-1]
        crosses[axis] = normal[axis][common] - halves[axis][:, common].T @ halves[axis]
        right[axis] -= half[:, :-1].T @ half[:, -1]
        chi_square -= float(half[:, -1] @ half[:, -1])
        determinant += 2.0 * float(np.log(np.diag(lower)).sum())
    crosses *= deviation_common[:, None]
    inner = crosses.sum(axis=0)[:, common] * deviation_common
    lower = np.linalg.cholesky(np.eye(len(common)) + inner)
    coupling = np.linalg.solve(lower, crosses).transpose(1, 0, 2)
    answer = np.linalg.solve(lower, right.sum(axis=0)[common] * deviation_common)
    right = right - np.einsum('kac,k->ac', coupling, answer)
    chi_square -= float(answer @ answer)
    determinant += 2.0 * float(np.log(np.diag(lower)).sum())
    return ConditionedDesign(
        normal=normal,
        half=halves,
        right=right,
        chi_square=chi_square,
        log_determinant=determinant,
        rows=rows,
        coupling=coupling,
    )


def _joined(priors: Sequence[CoefficientPrior]) -> tuple[list[int], FloatArray]:
    """Return the columns of several priors and their standard deviations."""
    columns = [c for prior in priors for c in prior.columns]
    return columns, np.concatenate([np.zeros(0), *(prior.deviation for prior in priors)])


def likeliest_coefficients(
    normal: FloatArray, right: FloatArray, priors: Sequence[CoefficientPrior]
) -> FloatArray:
    """Return (3, k) likeliest coefficients of the columns of priors, of unit length, in order.

    `normal` (3, c, c) and `right` (3, c) are equations of which those of `priors` count.
    """
    columns, deviation = _joined(priors)
    shared = np.repeat([p.shared for p in priors], [len(p.columns) for p in priors])
    size = len(columns)
    # Each axis has an unknown for every coefficient that is its own; shared ones come last.
    place = np.arange(size) + size * np.where(shared, 3, np.arange(3)[:, None])
    whole, target = np.eye(4 * size), np.zeros(4 * size)
    for axis, index in enumerate(place):
        whole[np.ix_(index, index)] += normal[axis][np.ix_(columns, columns)] * np.outer(
            deviation, deviation
        )
        target[index] += right[axis, columns] * deviation
    answer = np.linalg.solve(whole, target)
    return np.asarray(answer[place] * deviation)


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
    """Return ln evidence and Δχ² of columns together, those that the axes share as one.

    `normal` (3, c, c) and `right` (3, c) are equations of which those of `priors` count.
    """
    own, deviation = _joined([p for p in priors if not p.shared])
    common, deviation_common = _joined([p for p in priors if p.shared])
    index = np.array([*own, *common], dtype=np.int64)
    deviations = np.concatenate([deviation, deviation_common])
    whole = np.empty((3, len(index) + 1, len(index) + 1))
    _gather(normal, right, index, deviations, whole)
    determinant, delta_chi2 = _eliminated(whole, len(own))
    return float(log_evidence(chi_square - delta_chi2, determinant, rows)), delta_chi2


@inline()
def _log_pivots(left: FloatArray) -> FloatArray:
    """Eliminate all but the last unknown of I + `left` (k, k, s); return (s,) ln of the pivots."""
    total, factor = np.zeros(left.shape[2]), np.empty(left.shape[2])
    last = len(left) - 1
    for j in range(last):
        pivot = np.maximum(1.0 + left[j, j], LEAST_PIVOT)
        total += np.log(pivot)
        for i in range(j + 1, last + 1):
            factor[:] = left[j, i] / pivot
            for k in range(i, last + 1):
                for s in range(len(factor)):
                    left[i, k, s] -= factor[s] * left[j, k, s]
    return total


@njit(cache=True, nogil=True)
def _weigh(
    values: FloatArray, right: FloatArray, half: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return (f, s) ln |I + Λ XᵀX| and Δχ² of f forms of p coefficients at s prior variances.

    XᵀX is diagonal, `values` (f, p), less H Hᵀ, `half` (f, p, k): by the matrix determinant lemma
    and Woodbury's identity k unknowns are eliminated. Widths come last, computed side by side.
    """
    forms, size, coupled = half.shape
    widths = variance.shape[1]
    determinant, delta_chi2 = np.zeros((forms, widths)), np.zeros((forms, widths))
    inverse = np.empty(widths)
    for form in range(forms):
        left = np.zeros((coupled + 1, coupled + 1, widths))
        growth = np.ones(widths)
        for place in range(size):
            for s in range(widths):
                grown = 1.0 + variance[form, s] * values[form, place]
                growth[s] *= grown
                inverse[s] = variance[form, s] / grown
            if growth.max() > 1e200:
                determinant[form] += np.log(growth)
                growth[:] = 1.0
            for i in range(coupled + 1):
                one = right[form, place] if i == coupled else half[form, place, i]
                for k in range(i, coupled + 1):
                    other = right[form, place] if k == coupled else half[form, place, k]
                    for s in range(widths):
                        left[i, k, s] -= one * other * inverse[s]
        determinant[form] += np.log(growth)
        determinant[form] += _log_pivots(left)
        delta_chi2[form] = -left[coupled, coupled]
    return determinant, delta_chi2


@njit(cache=True, nogil=True)
def _gather(
    normal: FloatArray,
    right: FloatArray,
    index: IntArray,
    deviation: FloatArray,
    whole: FloatArray,
) -> None:
    """Fill the upper triangles of `whole` (3, k + 1, k + 1): k equations, the right side last."""
    size = len(index)
    for axis in range(3):
        for i in range(size):
            for k in range(i, size):
                scale = deviation[i] * deviation[k]
                whole[axis, i, k] = normal[axis, index[i], index[k]] * scale
            whole[axis, i, size] = right[axis, index[i]] * deviation[i]
        whole[axis, size, size] = 0.0


@njit(cache=True, nogil=True)
def _eliminated(whole: FloatArray, own: int) -> tuple[float, float]:
    """Return ln |I + Λ XᵀX| and Δχ² of equations (3, k + 1, k + 1), the right-hand side last.

    Gaussian elimination of the upper triangles: of the first `own` unknowns in each axis, then,
    in what is left of the three together, of those they share.
    """
    size = whole.shape[1]
    determinant = 0.0
    for axis in range(4):
        if axis == 3:
            for i in range(own, size):
                for k in range(i, size):
                    whole[0, i, k] += whole[1, i, k] + whole[2, i, k]
        matrix = whole[axis % 3]
        for j in range(own if axis == 3 else 0, size - 1 if axis == 3 else own):
            pivot = matrix[j, j] + 1.0
            determinant += math.log(pivot)
            for i in range(j + 1, size):
                factor = matrix[j, i] / pivot
                for k in range(i, size):
                    matrix[i, k] -= factor * matrix[j, k]
    return determinant, -whole[0, size - 1, size - 1]


def log_sum(values: FloatArray | Sequence[float]) -> float:
    """Return ln Σ exp(values)."""
    return float(np.logaddexp.reduce(np.asarray(values, dtype=np.float64)))
