# SPDX-License-Identifier: Apache-2.0
"""Devices that do not belong to their lot.

Per sensor two questions: are its three coefficients those of the lot, and is its misfit (held-out
error over noise floor) not above the lot's. Location and scatter come from the minimum covariance
determinant (Rousseeuw and Van Driessen 1999) and are then re-estimated from all devices but the
odd ones; the device under test is left out of both, so that the squared Mahalanobis distance of a
normal device follows Fisher's F exactly:
D² (n − d) n / (d (n + 1) (n − 1)) ~ F(d, n − d), n devices without it. Each coefficient is also
tested by itself (d = 1, Student's t squared): a deviation in one of them has to be larger to stand
out in the distance of all three.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray

from imu_workbench.fleet.statistics.vectors import Vectors

FALSE_ALARM_SHARE = 0.01
"""Share of ordinary devices that may be called odd, all questions together."""
COEFFICIENT_SHARE, MISFIT_SHARE = 0.75, 0.1
"""Shares of these false alarms for the two questions; the rest is a reserve, as scatters are
estimated and misfits not quite normal."""
TOGETHER_SHARE = 0.2
"""Share of the coefficients' false alarms for the distance of all three; the rest is for each
by itself."""
TRIMMED_P_VALUE = 1e-3
"""p-value below which a device does not count for location and scatter of its lot."""
LEAST_DEVICES = 12
"""Devices that a lot needs to be screened."""
MOST_ROUNDS = 10
START_DEVICES = 300
"""Devices that the robust start of a larger lot takes at least."""
SEED = 5
"""Seed of the subsets that the minimum covariance determinant starts from."""


@dataclass(frozen=True)
class OddDevice:
    """A device outside its lot, and why."""

    device: str
    lot: str
    sensor: str
    reason: str
    p_value: float
    deviations: tuple[float, ...]
    """What stands out, in standard deviations of the lot: three coefficients, or the misfit."""


@dataclass(frozen=True, eq=False)
class Screening:
    """The p-value of every device for both questions of one sensor."""

    coefficients: FloatArray
    """(n,) NaN in a lot that is too small."""
    misfit: FloatArray
    deviations: FloatArray
    """(n, 4) coefficients and misfit, in standard deviations of the lot."""


def screen(vectors: Vectors) -> Screening:
    """Return the p-value of each device in its lot."""
    n = len(vectors)
    found = Screening(np.full(n, np.nan), np.full(n, np.nan), np.full((n, 4), np.nan))
    for (kind, lot), group in vectors.groups():
        rows = (vectors.type == kind) & (vectors.lot == lot)
        if len(group) < LEAST_DEVICES:
            continue
        found.coefficients[rows], found.deviations[rows, :3] = p_values(group.coefficients)
        found.misfit[rows], found.deviations[rows, 3] = upper_p_values(group.misfit)
    return found


def upper_p_values(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (n,) p-values of values so large, and (n,) standardised values.

    Where only a part of a lot has an effect, misfits have a tail to one side: their scale is that
    of the upper tenth, where it is wider than the middle's.
    """
    from scipy.stats import norm, t

    middle, upper = np.quantile(values, [0.5, 0.9])
    inner = 1.4826 * np.median(np.abs(values - middle))
    z = (values - middle) / max(inner, (upper - middle) / norm.ppf(0.9), 1e-12)
    p: FloatArray = t.sf(z, len(values) - 1)
    return p, z


def p_values(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (n,) p-values of the rows of (n, d) values, and (n, d) standardised values."""
    scale = 1.4826 * np.median(np.abs(values - np.median(values, axis=0)), axis=0)
    y = (values - np.median(values, axis=0)) / np.where(scale > 0.0, scale, 1.0)
    kept = _first_clean(y)
    p = np.empty(len(y))
    for _ in range(MOST_ROUNDS):
        p = _left_out(y, kept)
        grown = p > TRIMMED_P_VALUE
        if grown.sum() <= y.shape[1] + 2 or (grown == kept).all():
            break
        kept = grown
    single = np.min([_left_out(column[:, None], kept) for column in y.T], axis=0)
    d = y.shape[1]
    p = np.minimum(p / TOGETHER_SHARE, d * single / (1.0 - TOGETHER_SHARE))
    spread = y[kept].std(axis=0, ddof=1)
    return np.minimum(p, 1.0), (y - y[kept].mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)


def _first_clean(y: FloatArray) -> NDArray[np.bool_]:
    from scipy.stats import chi2
    from sklearn.covariance import MinCovDet

    if y.shape[1] == 1:
        return np.abs(y[:, 0]) < 3.0
    robust = MinCovDet(random_state=SEED, support_fraction=0.75).fit(y[_spread_out(len(y))])
    clean: NDArray[np.bool_] = robust.mahalanobis(y) < chi2.ppf(0.99, y.shape[1])
    return clean


def _spread_out(n: int) -> slice:
    """Return every k-th device of a large lot: a few hundred are as good a start as all."""
    return slice(None, None, max(1, n // START_DEVICES))


def _left_out(y: FloatArray, kept: NDArray[np.bool_]) -> FloatArray:
    """Return (n,) p-values against the kept devices without the one under test."""
    from scipy.stats import f

    m, d = int(kept.sum()), y.shape[1]
    mean = y[kept].mean(axis=0)
    centred = y - mean
    scatter = centred[kept].T @ centred[kept]
    q = np.einsum('ni,ni->n', centred, np.linalg.solve(scatter, centred.T).T)
    # A device that is among the kept is taken out of mean and scatter (Sherman, Morrison).
    h = m / (m - 1.0)
    inside = q * h**2 / np.maximum(1.0 - h * q, 1e-12)
    size = np.where(kept, m - 1.0, float(m))
    distance = np.where(kept, inside, q) * (size - 1.0)
    statistic = distance * (size - d) * size / (d * (size + 1.0) * (size - 1.0))
    p: FloatArray = f.sf(statistic, d, size - d)
    return p


def odd_devices(screened: Sequence[tuple[Vectors, Screening]]) -> list[OddDevice]:
    """Return the devices outside their lot, rarest first.

    The share of false alarms is divided among the questions and sensors (Bonferroni).
    """
    level = COEFFICIENT_SHARE * FALSE_ALARM_SHARE / max(1, len(screened))
    misfit_level = MISFIT_SHARE * FALSE_ALARM_SHARE / max(1, len(screened))
    odd = []
    for vectors, screening in screened:
        for i in np.flatnonzero(screening.coefficients < level):
            own = screening.deviations[i, :3]
            worst = int(np.argmax(np.abs(own)))
            reason = f'slope of {"xyz"[worst]} {own[worst]:+.1f} σ from its lot'
            odd.append(_odd(vectors, int(i), reason, screening.coefficients[i], own))
        for i in np.flatnonzero(screening.misfit < misfit_level):
            own = screening.deviations[i, 3:]
            reason = f'fits worse than its lot by {own[0]:.1f} σ: an effect the others lack'
            odd.append(_odd(vectors, int(i), reason, screening.misfit[i], own))
    return sorted(odd, key=lambda one: one.p_value)


def _odd(vectors: Vectors, i: int, reason: str, p_value: float, own: FloatArray) -> OddDevice:
    return OddDevice(
        device=str(vectors.device[i]),
        lot=str(vectors.lot[i]),
        sensor=vectors.sensor,
        reason=reason,
        p_value=float(p_value),
        deviations=tuple(float(value) for value in own),
    )
