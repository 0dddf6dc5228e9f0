# SPDX-License-Identifier: Apache-2.0
"""A smoothing spline that is soft where the signal bends and stiff where it is straight.

A device that was switched on warms itself, one out of the freezer warms fast at first, a ramp
begins with a corner: one stiffness for the whole rounds them off, and lets noise through
elsewhere. f = argmin Σ (y − f)² + Σ λᵢ (∇³f)ᵢ² with λ of every place (Pintore, Speckman and
Holmes, Spatially adaptive smoothing splines, Biometrika 93, 2006): the third differences are
independent normal variables of variance σ²/λᵢ.
"""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray
from scipy.interpolate import CubicSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.ndimage import gaussian_filter1d

from thermal_comp.linear.differences import penalty_bands, settling_differences

WIDTH_IN_MEANS = 8.0
"""Width of the spline in means of rows that it is fitted to, at least where rows are closer."""
LEAST_MEANS = 40
"""Number of these below which one stiffness is enough."""
PROFILE_WIDTHS = 10.0
"""Standard deviation of the window over which third differences tell the stiffness, in widths."""
SETTLING = (1.0, 3.0, 10.0, 30.0, 100.0)
"""Time constants in which a device that warms itself settles at first [means] …"""
SETTLING_K = 1.0
"""… and deviation of how far: self-heating of 0.3 to 2 K."""
SETTLING_COST = 12.0
"""Gain of ln likelihood from which it does: that of a cold start's first bend is up to ten."""
ROUNDS = 4
"""Times the stiffness is taken from a spline with the stiffness of the time before."""
LARGEST_RATIO = 1e4
"""Of a stiffness to the mean one, either way: widths differ by five times."""
LEAST_STIFFNESS, GREATEST_STIFFNESS = 1e-2, 1e10
"""Beyond these a spline follows every mean, or its equations are too badly conditioned."""
LARGEST_LN_SCALE = 10.0
"""Of ln of the factor of all stiffness, either way."""


def adaptive_spline(values: FloatArray, width: float, every: int = 1) -> FloatArray | None:
    """Return values (n,) at equal distances through the likeliest spline.

    `width` [rows] is about that of the likeliest one of a single stiffness, `every` the rows
    between two measurements. Where the stiffness varies it costs a degree of freedom for every
    window of its profile. None for few rows, and where nothing is to be smoothed: a width of less
    than a row.
    """
    count = -(-max(int(width / WIDTH_IN_MEANS), 1) // every) * every
    size = len(values) // count
    if size < LEAST_MEANS or width < count:
        return None
    means = values[: size * count].reshape(size, count).mean(axis=1)
    base, (scale, course, likelihood) = _settling_first(means, (width / count) ** 6)
    window = PROFILE_WIDTHS * width / count
    least = likelihood + size / (2.0 * np.sqrt(np.pi) * window)
    best = course
    for _ in range(ROUNDS):
        bends = np.diff(course, 3) ** 2 * base / base[-1]
        power = gaussian_filter1d(bends, window, mode='nearest')
        ln_power = np.log(power + 1e-6 * power.mean() + 1e-300)
        bend = np.clip(ln_power - ln_power.mean(), -np.log(LARGEST_RATIO), np.log(LARGEST_RATIO))
        scale, course, likelihood = _likeliest_scale(means, base * np.exp(-bend), scale)
        if likelihood > least:
            least, best = likelihood, course
    middle = (np.arange(size) + 0.5) * count - 0.5
    return np.asarray(CubicSpline(middle, best)(np.arange(len(values))))


def _settling_first(
    means: FloatArray, stiffness: float
) -> tuple[FloatArray, tuple[float, FloatArray, float]]:
    """Return the stiffness (n − 3,) of one that is softer at first, where that is likelier.

    And ln of its likeliest factor, the spline, and ln of its likelihood. Without the first mean: a
    first reading that is off by itself settles nothing.
    """
    alike = np.full(len(means) - 3, stiffness)
    later = _likeliest_scale(means[1:], alike[1:], 0.0)
    variance = max(float(((means[1:] - later[1]) ** 2).mean()), 1e-300)
    best, least = alike, later[2] + SETTLING_COST
    for time_constant in SETTLING:
        settles = settling_differences(len(means), 3, SETTLING_K, time_constant)
        softer = 1.0 / (np.exp(-later[0]) / alike + settles**2 / variance)
        likelihood = _likeliest_scale(means[1:], softer[1:], 0.0)[2]
        if likelihood > least:
            best, least = softer, likelihood
    return best, _likeliest_scale(means, best, 0.0)


def _likeliest_scale(
    means: FloatArray, stiffness: FloatArray, scale: float
) -> tuple[float, FloatArray, float]:
    """Return ln of the likeliest factor of a stiffness, from `scale` on, its spline and its ln."""
    known: dict[float, tuple[FloatArray, float]] = {}
    here = np.inf
    while here != scale:
        here = scale
        # The one before first: of equals it stays, as where all stiffness is at its bounds.
        near = [one for one in (here, here - 1.0, here + 1.0) if abs(one) <= LARGEST_LN_SCALE]
        for one in near:
            if one not in known:
                known[one] = _fitted(means, stiffness * np.exp(one))
        scale = max(near, key=lambda one: known[one][1])
    return scale, *known[scale]


def _fitted(means: FloatArray, stiffness: FloatArray) -> tuple[FloatArray, float]:
    """Return the spline (n,) of a stiffness (n − 3,), and ln of its likelihood, σ² integrated."""
    size, stiffness = len(means), np.clip(stiffness, LEAST_STIFFNESS, GREATEST_STIFFNESS)
    normal = penalty_bands(3, stiffness)
    normal[-1] += 1.0
    root = cholesky_banded(normal)
    course = cho_solve_banded((root, False), means)
    squares = float(((means - course) ** 2).sum() + stiffness @ np.diff(course, 3) ** 2)
    free = (size - 3) * np.log(max(squares, 1e-300))
    return course, 0.5 * float(np.log(stiffness).sum() - free) - float(np.log(root[3]).sum())
