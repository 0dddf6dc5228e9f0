# SPDX-License-Identifier: Apache-2.0
"""Whether the error on held-out parts falls, or rises, beyond chance and by enough to matter."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray

LEAST_HELD_OUT_PARTS = 3
"""Parts of all runs together that a test of the held-out error needs."""
LARGEST_CHANCE = 0.01
"""Probability that a fall of the error on held-out parts is called one by chance."""
LEAST_FALL = 0.05
"""Fall of the held-out rms, as a share, from which it matters."""


def falls(
    before: FloatArray,
    after: FloatArray,
    noise: FloatArray | float,
    *,
    chance: float = LARGEST_CHANCE,
) -> bool:
    """Tell whether mean squares over k parts fall by more than chance and by enough to matter.

    Mean squares are (k,) or (k, axes); `noise` (axes,) is what noise alone leaves, and smaller
    ones count as so much. Student's t of ln(before / after) over the parts, and the rms over all.
    """
    from scipy.special import stdtrit  # takes a tenth of a second, which nodes need not wait

    if len(before) < LEAST_HELD_OUT_PARTS:
        return False
    before, after = in_floors(before, noise), in_floors(after, noise)
    if not falls_enough(before.sum(), after.sum()):
        return False
    fall = np.log(before / after)
    spread = float(fall.std(ddof=1)) / np.sqrt(len(fall))
    return bool(float(fall.mean()) > float(stdtrit(len(fall) - 1, 1.0 - chance)) * spread)


def falls_enough(before: float, after: float) -> bool:
    """Tell whether sums of squares fall by enough to matter."""
    return after <= (1.0 - LEAST_FALL) ** 2 * before


def rises(before: float, after: float) -> bool:
    """Tell whether a held-out rms rises by enough to matter."""
    return after > (1.0 + LEAST_FALL) * before


def parts_that_fall(before: FloatArray, after: FloatArray, noise: FloatArray | float) -> int:
    """Return in how many parts mean squares fall; arguments as of `falls`."""
    return int(np.sum(in_floors(after, noise) < in_floors(before, noise)))


def in_floors(squares: FloatArray, noise: FloatArray | float) -> FloatArray:
    """Return (k,) means over the axes of squares in those of noise, each at least 1."""
    above: FloatArray = np.maximum(squares / noise, 1.0).reshape(len(squares), -1).mean(axis=1)
    return above


def may_fall(squares: FloatArray, noise: FloatArray | float) -> bool:
    """Tell whether mean squares over parts are far enough above the noise for a fall to matter."""
    if not len(squares):
        return False
    above = float(np.maximum(squares / noise, 1.0).mean())
    return (1.0 - LEAST_FALL) ** 2 * above > 1.0
