# SPDX-License-Identifier: Apache-2.0
"""Noise that grows with vibration, and the lower weight of rows that were shaken.

A compressor that runs at times, or propellers, add noise to the means of some rows only. How much
a variance of samples adds to the variance of their mean depends on their spectrum; it is fitted to
what a saturated model leaves: the difference of neighbouring block means has the variance 2 s² (1
+ ρ u), u = variance of the acceleration beyond that of the quietest rows, with s² and ρ of each
axis those of the greatest likelihood (a multiplicative variance model; Harvey, Econometrica 44
(1976), 461-465).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.linear.columns import project_out
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.covariance import block_variances
from thermal_comp.noise.jumps import basis_with_jumps
from thermal_comp.noise.process import Shaking
from thermal_comp.noise.projection import LEAST_BLOCKS, Basis, FurtherColumns, basis_of_rows

STILL_ROWS_SHARE = 0.05
"""Quantile of the vibration up to which rows count as still."""
VARIANCE_RATIOS = np.r_[0.0, np.geomspace(0.05, 1e7, 64)]
"""Variances that the strongest vibration may add, over that of still rows."""
MOST_ROUNDS = 5
"""Largest number of fits of ratio and saturated model in turn, as shaken rows weigh less in
each."""
LARGEST_RATIO_CHANGE = 0.3
"""Relative change of the ratio below which the fits end."""
SHAKEN_EVIDENCE = 10.0
"""2 ln of the Bayes factor from which noise grows with vibration."""
SHAKEN_NOISE_RATIO = 2.0
"""Noise of a block, over that of still ones, from which it is called shaken."""
LEAST_VARIANCE_SHARE = 0.1
"""Share of a row's variance that a saturated model leaves, below which the row is not used."""


@dataclass(frozen=True, eq=False)
class VibrationNoise:
    """White noise of the means of one sensor, and what vibration adds to it."""

    white: FloatArray
    """(3,) of a one-second mean of still rows [unit²·s]."""
    density: FloatArray
    """(3,) of a one-second mean, per unit of vibration [unit²·s/(m/s²)²]."""
    still: float
    """Vibration up to which it adds nothing [(m/s²)²]."""
    ratio: float
    """Of the variance of a still block, per unit of vibration; mean of the axes [1/(m/s²)²]."""

    @classmethod
    def of_model(cls, noise: NoiseModel, period: float) -> VibrationNoise:
        """Return that part of a noise model, for means over `period` seconds."""
        still = np.maximum(noise.variance_of_means(period), 1e-300)
        ratio = float(np.mean(noise.per_vibration / period / still))
        return cls(
            white=noise.white**2,
            density=noise.per_vibration,
            still=noise.still_vibration,
            ratio=ratio,
        )

    def shaking(self, run: PreparedRun, rows: NDArray[np.bool_]) -> Shaking | None:
        """Return how it shakes some blocks of a run; None where it adds nothing."""
        if run.vibration is None or not self.ratio:
            return None
        excess = np.maximum(run.vibration[rows] - self.still, 0.0)
        return Shaking(1.0 / np.sqrt(1.0 + self.ratio * excess), excess / run.period)


NO_VIBRATION_NOISE = VibrationNoise(white=np.zeros(3), density=np.zeros(3), still=0.0, ratio=0.0)
"""Noise that does not depend on vibration."""


def noise_of_vibration(
    runs: Sequence[PreparedRun],
    sensor: Sensor,
    saturated: Basis,
    furthers: Sequence[FurtherColumns],
) -> VibrationNoise:
    """Return how the noise of a sensor grows with vibration, as far as that is beyond chance.

    `furthers` are columns of each run that the saturated model does not follow.
    """
    used = [
        (run, valid, further)
        for run, further in zip(runs, furthers, strict=True)
        if run.vibration is not None and (valid := run.valid(sensor)).sum() >= LEAST_BLOCKS
    ]
    if not used:
        return NO_VIBRATION_NOISE
    vibration = np.concatenate([_vibration(run, rows) for run, rows, _ in used])
    still = float(np.quantile(vibration, STILL_ROWS_SHARE))
    largest = float(vibration.max()) - still
    found = replace(NO_VIBRATION_NOISE, still=still)
    for _ in range(MOST_ROUNDS if largest > 0.0 else 0):
        parts = [_differences(*one, sensor, saturated, found) for one in used]
        squares, excess = (np.concatenate(part) for part in zip(*parts, strict=True))
        axes = [_most_likely(axis, excess / largest) for axis in squares.T]
        ratio, variance, evidence = np.array(axes).T
        if evidence.sum() - 3.0 * np.log(len(vibration)) < SHAKEN_EVIDENCE:
            return NO_VIBRATION_NOISE
        before, white = found, variance * runs[0].period
        found = VibrationNoise(
            white=white,
            density=ratio * white / largest,
            still=still,
            ratio=ratio.mean() / largest,
        )
        if np.isclose(found.ratio, before.ratio, rtol=LARGEST_RATIO_CHANGE):
            break
    return found if found.ratio else NO_VIBRATION_NOISE


def _vibration(run: PreparedRun, rows: NDArray[np.bool_]) -> FloatArray:
    assert run.vibration is not None  # noqa: S101 (runs without it are left out)
    return run.vibration[rows]


def _differences(
    run: PreparedRun,
    valid: NDArray[np.bool_],
    further: FurtherColumns,
    sensor: Sensor,
    saturated: Basis,
    known: VibrationNoise,
) -> tuple[FloatArray, FloatArray]:
    """Return half the squares of differences of neighbours (k, 3), and their mean excess (k,).

    Jumps are taken out: one among shaken rows would be taken for their noise.
    """
    shaking = known.shaking(run, valid)
    basis = basis_of_rows(run, valid, saturated, further, shaking)
    weights = np.ones((len(basis), 1)) if shaking is None else shaking.weights[:, None]
    weighted = weights * run.measured[sensor][valid]
    basis = basis_with_jumps(weighted, run.slot[valid], basis, weights[:, 0])
    share = 1.0 - (basis**2).sum(axis=1)
    left = project_out(basis, weighted) / weights
    left /= np.sqrt(np.maximum(share, LEAST_VARIANCE_SHARE))[:, None]
    excess = np.maximum(_vibration(run, valid) - known.still, 0.0)
    used = np.minimum(share[1:], share[:-1]) > LEAST_VARIANCE_SHARE
    return 0.5 * np.diff(left, axis=0)[used] ** 2, 0.5 * (excess[1:] + excess[:-1])[used]


def _most_likely(squares: FloatArray, excess: FloatArray) -> tuple[float, float, float]:
    """Return ρ, s² and 2 ln of the likelihood ratio to ρ = 0 of squares with mean s² (1 + ρ u).

    Differences of neighbours share a value: two thirds of them are independent.
    """
    factor = 1.0 + np.multiply.outer(VARIANCE_RATIOS, excess)
    variance = np.maximum((squares / factor).mean(axis=1), 1e-300)
    likelihood = -len(squares) * np.log(variance) - np.log(factor).sum(axis=1)
    best = int(np.argmax(likelihood))
    evidence = (2.0 / 3.0) * float(likelihood[best] - likelihood[0])
    return float(VARIANCE_RATIOS[best]), float(variance[best]), evidence


def note_of_vibration(noise: NoiseModel, runs: Sequence[PreparedRun], sensor: Sensor) -> str:
    """Return a sentence where vibration makes a sensor's noise much larger, '' elsewhere."""
    if not noise.per_vibration.any():
        return ''
    variances = np.concatenate([block_variances(noise, run) for run in runs])
    factor = np.sqrt(variances / noise.variance_of_means(runs[0].period)).max(axis=1)
    if not (factor > SHAKEN_NOISE_RATIO).any():
        return ''
    return (
        f'{sensor}: its noise grows with vibration, up to {factor.max():.3g} times; '
        f'{np.sum(factor > SHAKEN_NOISE_RATIO)} of {len(factor)} blocks have more than '
        f'{SHAKEN_NOISE_RATIO:g} times that of still ones and count as much less'
    )
