# SPDX-License-Identifier: Apache-2.0
"""Whether an error is Gaussian, by χ² of samples thinned until they are independent; its modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import PHASES, FloatArray, IntArray
from scipy import special

LEAST_EXPECTED_COUNT = 8
"""Least expected count in a class of the χ² test."""
LEAST_SAMPLES = 40
"""Independent samples that the test needs."""


@dataclass(frozen=True)
class Gaussianity:
    """χ² test of one axis against a Gaussian of its own mean and standard deviation."""

    p_value: float
    """NaN where there are too few independent samples."""
    chi_square: float
    degrees: int
    effective_n: int
    """Number of samples that are left after thinning."""
    thinning: int
    """Blocks from one sample to the next."""

    @property
    def gaussian(self) -> bool | None:
        """Whether a Gaussian is compatible at the 5 % level; None where there was no test."""
        return None if np.isnan(self.p_value) else self.p_value >= 0.05


@dataclass(frozen=True, eq=False)
class DwellModes:
    """Mean error in the cold and in the hot dwells: the two modes of its distribution."""

    cold: FloatArray
    """(3,) mean in `dwell_cold` [unit]."""
    hot: FloatArray
    """(3,) mean in `dwell_hot` [unit]."""
    separation: FloatArray
    """(3,) |hot − cold| over the standard deviation within the dwells."""

    @property
    def bimodal(self) -> list[bool]:
        """Whether two equal Gaussians that far apart have two modes (separation above 2)."""
        return [bool(s > 2.0) for s in self.separation]


def gaussianity(runs: Sequence[FloatArray]) -> Gaussianity:
    """Return the test of one axis, given its values (m,) in order of time, run by run.

    Values are thinned by their integrated autocorrelation time; classes are equiprobable; two
    degrees of freedom go to the estimated mean and deviation.

    >>> rng = np.random.default_rng(1)
    >>> gaussianity([rng.standard_normal(2000)]).gaussian
    True
    >>> two_levels = np.sign(np.sin(np.arange(2000.0)))
    >>> gaussianity([two_levels + 0.1 * rng.standard_normal(2000)]).gaussian
    False
    """
    thinning = correlation_length(runs)
    thinned = np.concatenate([run[thinning // 2 :: thinning] for run in runs])
    n = len(thinned)
    spread = float(thinned.std(ddof=1)) if n > 1 else 0.0
    if n < LEAST_SAMPLES or spread == 0.0:
        return Gaussianity(
            p_value=np.nan, chi_square=np.nan, degrees=0, effective_n=n, thinning=thinning
        )
    classes = int(np.clip(n // LEAST_EXPECTED_COUNT, 5, 30))
    probability = special.ndtr((thinned - thinned.mean()) / spread)
    counts = np.bincount(np.minimum((probability * classes).astype(int), classes - 1))
    counts = np.pad(counts, (0, classes - len(counts)))
    chi_square = float(((counts - n / classes) ** 2).sum() / (n / classes))
    degrees = classes - 3
    return Gaussianity(
        p_value=float(special.chdtrc(degrees, chi_square)),
        chi_square=chi_square,
        degrees=degrees,
        effective_n=n,
        thinning=thinning,
    )


def correlation_length(runs: Sequence[FloatArray]) -> int:
    """Return the integrated autocorrelation time of the values, in samples, at least 1.

    1 + 2 Σ ρ_k, summed until it is shorter than a fifth of the lag (Sokal's window).
    """
    size = max(len(run) for run in runs)
    total = np.zeros(size)
    for run in runs:
        spectrum = np.abs(np.fft.rfft(run - run.mean(), 2 * size)) ** 2
        total += np.fft.irfft(spectrum, 2 * size)[:size]
    if total[0] <= 0.0:
        return 1
    length = 1.0 + 2.0 * np.cumsum(total[1:] / total[0])
    long_enough = np.flatnonzero(np.arange(1, size) >= 5.0 * length)
    if not long_enough.size:
        return max(1, size // 5)
    return max(1, round(float(length[long_enough[0]])))


def dwell_modes(values: FloatArray, phase: IntArray) -> DwellModes | None:
    """Return the modes of an error (m, 3) in the dwells; None without cold and hot dwells."""
    cold = values[phase == PHASES.index('dwell_cold')]
    hot = values[phase == PHASES.index('dwell_hot')]
    cold, hot = (part[np.isfinite(part).all(axis=1)] for part in (cold, hot))
    if min(len(cold), len(hot)) < 5:
        return None
    within = np.sqrt((cold.var(axis=0) + hot.var(axis=0)) / 2.0)
    apart = np.abs(hot.mean(axis=0) - cold.mean(axis=0))
    return DwellModes(cold.mean(axis=0), hot.mean(axis=0), apart / np.maximum(within, 1e-300))
