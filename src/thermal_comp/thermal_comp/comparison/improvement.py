# SPDX-License-Identifier: Apache-2.0
"""Does the error on held-out parts fall, or rise, by more than chance and by enough to matter?"""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray
from scipy.special import stdtrit

LEAST_PARTS = 3
"""Parts held out from which anything is said."""
LARGEST_CHANCE = 0.01
"""Probability that chance alone passes for a fall of the error on held-out parts."""
LEAST_FALL = 0.05
"""Fall of the held-out rms that is worth another term, as a share."""


def falls(before: FloatArray, after: FloatArray, noise: FloatArray | float) -> bool:
    """Tell whether mean squares over k parts fall by more than chance and by enough to matter.

    (k,) or (k, axes); `noise` is the square that noise alone leaves, (axes,): what lies below it
    counts as noise. Student's t of ln(before / after) over the parts, and the rms over all.
    """
    if len(before) < LEAST_PARTS:
        return False
    before, after = _in_floors(before, noise), _in_floors(after, noise)
    if not falls_enough(before.sum(), after.sum()):
        return False
    gain = np.log(before / after)
    spread = float(gain.std(ddof=1)) / np.sqrt(len(gain))
    return bool(float(gain.mean()) > float(stdtrit(len(gain) - 1, 1.0 - LARGEST_CHANCE)) * spread)


def falls_enough(before: float, after: float) -> bool:
    """Tell whether sums of squares fall by enough to matter."""
    return after <= (1.0 - LEAST_FALL) ** 2 * before


def rises(before: float, after: float) -> bool:
    """Tell whether a held-out rms rises by enough to matter."""
    return after > (1.0 + LEAST_FALL) * before


def parts_that_fall(before: FloatArray, after: FloatArray, noise: FloatArray | float) -> int:
    """Return in how many parts mean squares fall; arguments as of `falls`."""
    return int(np.sum(_in_floors(after, noise) < _in_floors(before, noise)))


def _in_floors(squares: FloatArray, noise: FloatArray | float) -> FloatArray:
    """(k,) mean over the axes of squares over that of noise, at least 1."""
    above: FloatArray = np.maximum(squares / noise, 1.0).reshape(len(squares), -1).mean(axis=1)
    return above


def may_fall(squares: FloatArray, noise: FloatArray | float) -> bool:
    """Tell whether mean squares over parts are far enough above the noise for a fall to matter."""
    if not len(squares):
        return False
    above = float(np.maximum(squares / noise, 1.0).mean())
    return (1.0 - LEAST_FALL) ** 2 * above > 1.0
