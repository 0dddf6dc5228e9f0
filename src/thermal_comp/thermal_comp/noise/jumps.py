# SPDX-License-Identifier: Apache-2.0
"""Sudden changes of level between block means, which are taken out before noise is fitted."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.linear.columns import LEAST_NEW_LENGTH
from thermal_comp.noise.saturated_model import joined_basis

JUMP_DEVIATIONS = 12.0
"""Difference of neighbouring blocks, in standard deviations, from which it is a jump."""
MOST_JUMPS = 6
"""Jumps of a run, at most: a level that jumps more often is switched by something."""


def jump_columns(
    values: FloatArray, slot: IntArray, basis: FloatArray, weights: FloatArray | float = 1.0
) -> FloatArray:
    """Return steps (m, q) at the jumps of block means (m, 3), none where there are too many.

    `values`, `basis` (m, p; orthonormal) and the steps that are returned are weighted by
    `weights` (m,).

    The largest difference between neighbours of what the basis leaves becomes a step that joins
    the basis, until no difference is a jump. Its scale is 1.4826 times the median absolute
    difference. A jump within a block shows in two differences and has two steps.
    """
    taken = np.diff(slot) > 1
    found: list[FloatArray] = []
    left = values - basis @ (basis.T @ values)
    while len(found) <= MOST_JUMPS:
        difference = np.abs(np.diff(left, axis=0))
        scale = 1.4826 * np.median(difference, axis=0)
        far = (difference / np.maximum(scale, 1e-300)).max(axis=1)
        far[taken] = 0.0
        at = int(np.argmax(far))
        if far[at] <= JUMP_DEVIATIONS:
            return np.reshape(found, (-1, len(values))).T
        step: FloatArray = weights * (np.arange(len(values)) > at).astype(np.float64)
        found.append(step)
        taken[at] = True
        new = step - basis @ (basis.T @ step)
        new = new - basis @ (basis.T @ new)
        size = float(np.linalg.norm(new))
        if size < LEAST_NEW_LENGTH * np.linalg.norm(step):
            break
        basis = np.column_stack([basis, new / size])
        left = left - np.outer(new, new @ left) / size**2
    return np.zeros((len(values), 0))


def basis_with_jumps(
    values: FloatArray, slot: IntArray, basis: FloatArray, weights: FloatArray | float = 1.0
) -> FloatArray:
    """Return the basis joined with the `jump_columns` of the values."""
    jumps = jump_columns(values, slot, basis, weights)
    return joined_basis([basis, jumps]) if jumps.shape[1] else basis
