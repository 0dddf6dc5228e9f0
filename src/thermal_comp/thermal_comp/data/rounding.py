# SPDX-License-Identifier: Apache-2.0
"""Sensors that are read in counts coarser than their noise: the counts, and the noise beside them.

Rounding a signal x with noise σ to counts q adds Σ (−1)ᵏ q/(πk) · exp(−2π²k²σ²/q²) · sin(2πk x/q)
to its mean (Widrow and Kollár, Quantization Noise, 2008, ch. 4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray

ONE_COUNT_SHARE = 0.95
"""Share of changes by one count among all from which counts are coarser than the noise."""
COUNTS_OF_NOISE = np.geomspace(1.0, 30.0, 200)
"""Ratios of a count to the noise that are told from one another."""
HARMONICS = np.arange(1, 100)
"""Orders k of the sum over waves: those beyond are nothing beside the noise."""
MOST_COUNTS = 2.0
"""Size [counts] as which a larger step is taken: it is a spike, not noise."""


@dataclass(frozen=True, eq=False)
class Rounding:
    """How coarsely a sensor is read."""

    count: FloatArray
    """(3,) one count of each axis where it is coarser than the noise, else 0 [unit]."""
    noise: FloatArray
    """(3,) standard deviation of a sample before rounding; 0 where counts are fine [unit]."""

    @classmethod
    def of(cls, values: FloatArray) -> Rounding:
        """Return that of samples (n, 3)."""
        count = coarse_counts(values)
        count = np.where(np.isfinite(count), count, 0.0)
        steps = _some_steps(values)
        noise = [_noise_beside(c, column) for c, column in zip(count, steps.T, strict=True)]
        return cls(count, np.array(noise))

    def wave_sizes(self, harmonics: int) -> FloatArray:
        """Return (3, harmonics) the amplitudes of what rounding adds to the mean [unit]."""
        order = np.arange(1, harmonics + 1)
        fine = self.count == 0.0
        ratio = np.where(fine, 0.0, self.noise / np.where(fine, 1.0, self.count))[:, None]
        left = np.exp(-2.0 * (np.pi * order * ratio) ** 2)
        return np.asarray(self.count[:, None] * left / (np.pi * order))


def coarse_counts(values: FloatArray) -> FloatArray:
    """Return (3,) one count of each axis where it is coarser than the noise, else 0.

    ∞ where an axis never changes.
    """
    counts = np.zeros(values.shape[1])
    for axis, column in enumerate(_some_steps(values).T):
        moved = column[column > 0.0]
        if not len(moved):
            counts[axis] = np.inf
        elif (moved < 1.5 * moved.min()).mean() > ONE_COUNT_SHARE:
            counts[axis] = moved.min()
    return counts


def _some_steps(values: FloatArray) -> FloatArray:
    """Return the sizes (k, 3) of steps from row to row, of long recordings evenly spread ones."""
    rows = some_rows(len(values) - 1)
    with np.errstate(invalid='ignore'):
        return np.abs(values[rows + 1] - values[rows])


def _noise_beside(count: float, steps: FloatArray) -> float:
    """Return the noise of samples whose steps have sizes (n,) of whole counts; 0 for a count of 0.

    Of the mean square of a step, wherever the signal stands between two counts:
    2 (σ² + q²/12 − Σ ½ (q/(πk))² exp(−4π²k²σ²/q²)).
    """
    known = steps[np.isfinite(steps)]
    if count == 0.0 or not len(known):
        return 0.0
    square = float((np.minimum(np.round(known / count), MOST_COUNTS) ** 2).mean())
    each = np.exp(-((2.0 * np.pi * HARMONICS / COUNTS_OF_NOISE[:, None]) ** 2))
    waves = (each / (np.pi * HARMONICS) ** 2).sum(axis=1)
    expected = 2.0 * (1.0 / COUNTS_OF_NOISE**2 + 1.0 / 12.0) - waves
    return count / float(np.interp(-square, -expected, COUNTS_OF_NOISE))


def some_rows(rows: int, wanted: int = 200_000) -> NDArray[np.intp]:
    """Return about so many of the rows, evenly spread: enough for a median."""
    return np.arange(0, rows, max(rows // wanted, 1))
