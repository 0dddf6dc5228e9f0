# SPDX-License-Identifier: Apache-2.0
"""Jumps far beyond the noise of a block: whatever they are, they are not noise."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray, IntArray

FAR = 12.0
"""Difference of neighbouring blocks, in standard deviations, that noise does not reach."""
MOST = 6
"""Steps per run; what jumps more often switches, and is no accident."""


def jump_columns(values: FloatArray, slot: IntArray, basis: FloatArray) -> FloatArray:
    """Return steps (m, q) at the jumps of block means (m, 3), none where there are too many.

    The largest difference of what `basis` (m, p; orthonormal) leaves is made a step and joins
    the basis, until none is far. The scale of a difference is 1.4826 times its median absolute
    value. A jump within a block shows in two differences and has two steps.
    """
    taken = np.diff(slot) > 1
    found: list[FloatArray] = []
    left = values - basis @ (basis.T @ values)
    while len(found) <= MOST:
        difference = np.abs(np.diff(left, axis=0))
        scale = 1.4826 * np.median(difference, axis=0)
        far = (difference / np.maximum(scale, 1e-300)).max(axis=1)
        far[taken] = 0.0
        at = int(np.argmax(far))
        if far[at] <= FAR:
            return np.reshape(found, (-1, len(values))).T
        step = (np.arange(len(values)) > at).astype(np.float64)
        found.append(step)
        taken[at] = True
        new = step - basis @ (basis.T @ step)
        new = new - basis @ (basis.T @ new)
        size = float(np.linalg.norm(new))
        if size < 1e-6:
            break
        basis = np.column_stack([basis, new / size])
        left = left - np.outer(new, new @ left) / size**2
    return np.zeros((len(values), 0))
