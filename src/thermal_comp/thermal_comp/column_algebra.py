# SPDX-License-Identifier: Apache-2.0
"""Columns of several runs and axes beside each other, and equations some of them leave open."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray

RANK_TOLERANCE = 1e-7
"""Directions of a normal matrix below this share of the largest count as undetermined."""


def per_axis(columns: FloatArray) -> tuple[FloatArray, bool]:
    """Return (rows, 3, p) and whether the axes share coefficients.

    Columns that act on one axis each, as many on every axis, are p / 3 columns per axis.
    """
    if columns.ndim == 2:
        shape = (len(columns), 3, columns.shape[1])
        return np.broadcast_to(columns[:, None, :], shape), False
    acts = np.abs(columns).max(axis=0) > 0.0
    counts = acts.sum(axis=1)
    if (acts.sum(axis=0) != 1).any() or counts.max() != counts.min():
        return columns, True
    return np.stack([columns[:, axis][:, acts[axis]] for axis in range(3)], axis=1), False


def block_diagonal(parts: Sequence[FloatArray]) -> FloatArray:
    """Put each run's columns beside each other, zero in the other runs' rows."""
    width = sum(part.shape[-1] for part in parts)
    whole = np.zeros((sum(len(part) for part in parts), *parts[0].shape[1:-1], width))
    row = column = 0
    for part in parts:
        whole[row : row + len(part), ..., column : column + part.shape[-1]] = part
        row, column = row + len(part), column + part.shape[-1]
    return whole


def orthonormal(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the span of columns (rows, p); zero columns drop."""
    size = np.linalg.norm(columns, axis=0)
    left, weights, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(left[:, weights > 1e-9 * weights[0]])


def pseudo_solve(
    normal: FloatArray, right: FloatArray, full: FloatArray | None = None
) -> tuple[FloatArray, int]:
    """Return the minimum-norm solution and the rank; undetermined directions stay zero."""
    if not len(normal):
        return np.zeros((0, right.shape[1])), 0
    size = np.sqrt(np.maximum(np.diag(normal) if full is None else full, 0.0))
    inverse = np.where(size > 1e-9, 1.0 / np.maximum(size, 1e-9), 0.0)
    scaled = normal * inverse[:, None] * inverse[None, :]
    values, vectors = np.linalg.eigh(scaled)
    kept: NDArray[np.bool_] = values > RANK_TOLERANCE
    vectors = vectors[:, kept]
    turned = vectors.T @ (right * inverse[:, None])
    answer = inverse[:, None] * (vectors @ (turned / values[kept][:, None]))
    return answer, int(kept.sum())
