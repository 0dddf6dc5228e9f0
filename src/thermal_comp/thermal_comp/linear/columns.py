# SPDX-License-Identifier: Apache-2.0
"""Columns of several runs and axes beside each other, bases of their span, and the rank rule.

Of columns of unit length a direction counts where at least LEAST_NEW_LENGTH is left of it beside
the others; less is rounding, or the noise of a thermometer between two columns. Normal matrices
hold squares: there it is LEAST_NEW_POWER. All bases and solutions go by it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_recording.recording import FloatArray

LEAST_NEW_LENGTH = 1e-5
"""Length that columns of unit length must have in a direction for it to count."""
LEAST_NEW_POWER = LEAST_NEW_LENGTH**2
"""Its square: the least eigenvalue, or the least that a column has left, of a normal matrix."""


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


def orthonormal(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the span of columns (rows, p); zero columns drop.

    >>> orthonormal(np.array([[1.0, 2.0, 0.0], [1.0, 2.0, 0.0]])).shape
    (2, 1)
    """
    size = np.linalg.norm(columns, axis=0)
    if not (size > 0.0).any():
        return np.zeros((len(columns), 0))
    left, weights, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(left[:, weights > LEAST_NEW_LENGTH])


def log_volume(columns: FloatArray) -> float:
    """Return ln of the volume that columns (rows, p) span, of the directions `orthonormal` keeps.

    What their coefficients with a flat prior take of an evidence: ½ ln det XᵀX.
    """
    size = np.linalg.norm(columns, axis=0)
    if not (size > 0.0).any():
        return 0.0
    weights = np.linalg.svd(columns[:, size > 0] / size[size > 0], compute_uv=False)
    kept = weights[weights > LEAST_NEW_LENGTH]
    return float(np.log(kept).sum() + np.log(size[size > 0]).sum())


def project_out(basis: FloatArray, columns: FloatArray) -> FloatArray:
    """Return what an orthonormal basis (rows, q) leaves of columns (rows, p)."""
    rest: FloatArray = columns - basis @ (basis.T @ columns)
    return rest
