# SPDX-License-Identifier: Apache-2.0
"""Columns of several runs and axes beside each other, and orthonormal bases of their span."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_recording.recording import FloatArray

DEPENDENT_DIRECTION = 1e-9
"""Singular values of columns of unit length below this share of the largest are rounding."""


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


def stack_runs(parts: Sequence[FloatArray], *, per_run: bool) -> FloatArray:
    """Return the runs' columns (m, …, p) below each other; `per_run` gives each run its own p."""
    if not per_run:
        return np.concatenate(parts)
    width = sum(part.shape[-1] for part in parts)
    whole = np.zeros((sum(len(part) for part in parts), *parts[0].shape[1:-1], width))
    row = column = 0
    for part in parts:
        whole[row : row + len(part), ..., column : column + part.shape[-1]] = part
        row, column = row + len(part), column + part.shape[-1]
    return whole


def orthonormal(columns: FloatArray, tolerance: float = DEPENDENT_DIRECTION) -> FloatArray:
    """Return an orthonormal basis of the span of columns (rows, p); zero columns drop.

    >>> orthonormal(np.array([[1.0, 2.0, 0.0], [1.0, 2.0, 0.0]])).shape
    (2, 1)
    """
    size = np.linalg.norm(columns, axis=0)
    if not (size > 0.0).any():
        return np.zeros((len(columns), 0))
    left, weights, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(left[:, weights > tolerance * weights[0]])


def log_volume(columns: FloatArray, tolerance: float = DEPENDENT_DIRECTION) -> float:
    """Return ln of the volume that columns (rows, p) span, of the directions `orthonormal` keeps.

    What their coefficients with a flat prior take of an evidence: ½ ln det XᵀX.
    """
    size = np.linalg.norm(columns, axis=0)
    if not (size > 0.0).any():
        return 0.0
    weights = np.linalg.svd(columns[:, size > 0] / size[size > 0], compute_uv=False)
    return float(
        np.log(weights[weights > tolerance * weights[0]]).sum() + np.log(size[size > 0]).sum()
    )


def project_out(basis: FloatArray, columns: FloatArray) -> FloatArray:
    """Return what an orthonormal basis (rows, q) leaves of columns (rows, p)."""
    rest: FloatArray = columns - basis @ (basis.T @ columns)
    return rest
