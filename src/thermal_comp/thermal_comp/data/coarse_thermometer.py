# SPDX-License-Identifier: Apache-2.0
"""The temperature behind a thermometer whose counts are coarser than its noise.

A reading y says that T + noise was within half a count of it, no more:
ln P(y | T) = ln [Φ((y + q/2 − T)/σ) − Φ((y − q/2 − T)/σ)].
While it stays within a count the temperature is told by the instants at which it went from one
count to the next, and by how smooth it is: its second or third differences are normal with one
deviation ρ (a smoothing spline, Wahba, Spline Models for Observational Data, 1990, ch. 1), larger
at first where a device warms itself. The likeliest course is found by Newton's method, σ, ρ and
the order by the marginal likelihood in Laplace's approximation (Rasmussen and Williams, Gaussian
Processes for Machine Learning, 2006, sec. 3.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from scipy.interpolate import CubicSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.ndimage import median_filter
from scipy.sparse.linalg import LinearOperator, eigsh
from scipy.special import log_ndtr

from thermal_comp.data.adaptive_spline import SETTLING_COST, SETTLING_K
from thermal_comp.data.thermometer_counts import counts_of
from thermal_comp.linear.differences import difference, penalty_bands, settling_differences

LEAST_HELD_SHARE = 0.6
"""Share of rows that repeat the one before, from which the noise is below the counts."""
MOST_ROWS_A_READING, ON_TIME_SHARE = 120, 0.95
"""Rows between two readings that are written into every row, at most, and share of the changes
that come after whole numbers of them."""
LEAST_MEANS, MOST_MEANS = 40, 4000
"""Number of means of rows that a course is fitted to."""
SPIKE = 5.0
"""Distance of a reading from both of its neighbours that is none of the temperature [counts]."""
LARGEST_SPAN = 1.5
"""Counts a mean extends over, from which it is as good as one of a fine thermometer."""
FINE_NOISE = 0.1
"""Noise of such a mean [counts]."""
NOISES = tuple(np.geomspace(0.000625, 0.32, 10).tolist())
"""Noise of a reading [counts]."""
LARGEST_NOISE = 0.2
"""Noise above which the mean of the readings says as much as their counts [counts]."""
DEVIATIONS = tuple(np.geomspace(1e-7, 1.0, 15).tolist())
"""Deviations of the differences [counts]."""
ORDERS = (3, 2)
"""Orders of the differences: of a die behind its package, and of one that air heats at once."""
SETTLING = (0.0, 1.0, 3.0, 10.0)
"""Time constants [means] in which a device that warms itself settles at first; 0: it does not."""
MOVES = (
    (0, -1, 0, 0),
    (0, 1, 0, 0),
    (-1, 0, 0, 0),
    (1, 0, 0, 0),
    (-1, -1, 0, 0),
    (-1, 1, 0, 0),
    (0, 0, 1, 0),
    (0, 2, 1, 0),
    (0, 0, 0, 1),
)
"""Steps of the search in places of NOISES, DEVIATIONS, ORDERS and SETTLING."""
MOST_STEPS = 60
"""Of Newton's method."""
CONVERGED = 1e-2
"""Gain of ln of a probability that is none."""
LEAST_DAMPING = 1e-2
"""Of Newton's method, from which its steps are whole [1/counts²]."""
UNIFORM = 12.0
"""Inverse variance of what is alike anywhere within a count [1/counts²]."""
LEAST_CURVATURE, ROUNDING = 1e-6, 1e-14
"""Added to the diagonal, of rows that say nothing [1/counts²], and of its largest part."""
_LN_SQRT_2PI = 0.5 * np.log(2.0 * np.pi)


@dataclass(frozen=True, eq=False)
class CoarseCourse:
    """The likeliest course of a temperature, and how far it may be from it."""

    middles: FloatArray
    """(m,) places of the means it was fitted to [rows]."""
    values: FloatArray
    """(m,) the course there [K]."""
    root: FloatArray
    """(b, m) banded Cholesky factor of its inverse covariance [1/K²]."""
    count: float
    """Size of a count [K]."""

    def at(self, rows: FloatArray) -> FloatArray:
        """Return the course at places (n,) [rows]."""
        return np.asarray(CubicSpline(self.middles, self.values)(rows))

    def errors(self, rows: FloatArray, count: int) -> FloatArray:
        """Return the (n, e) largest independent errors it may have there, one deviation each [K].

        Together they are nowhere larger than the error of a reading by itself, count/√12.
        """
        size = len(self.values)
        covariance = LinearOperator(
            (size, size), matvec=lambda v: cho_solve_banded((self.root, False), v), dtype=float
        )
        power, shape = eigsh(covariance, min(count, size - 1), v0=np.ones(size))
        errors = CubicSpline(self.middles, shape * np.sqrt(np.maximum(power, 0.0)))(rows)
        together = np.sqrt((errors**2).sum(axis=1, keepdims=True))
        return np.asarray(errors * np.minimum(1.0, self.count / np.sqrt(12.0) / together))


def coarse_course(temperature: FloatArray, counts: Sequence[float] = ()) -> CoarseCourse | None:
    """Return the course behind readings (n,) at equal distances; None where noise is the larger.

    A row between two `counts` (those of the thermometer, ascending; else of the rows) is a mean of
    readings of both.
    """
    change = np.flatnonzero(np.diff(temperature))
    repeated = len(temperature) - len(change)
    if repeated < LEAST_HELD_SHARE * len(temperature) or _is_read_seldom(change):
        return None
    levels = np.asarray(counts or counts_of(temperature))
    every = -(-len(temperature) // MOST_MEANS)
    size = len(temperature) // max(every, 1)
    if len(levels) < 2 or size < LEAST_MEANS:
        return None
    last = len(levels) - 1
    kelvin = float(levels[-1] - levels[0]) / last
    beyond = temperature - np.clip(temperature, levels[0], levels[-1])
    rows = np.interp(temperature, levels, np.arange(last + 1)) + beyond / kelvin
    usual = median_filter(rows, 3, mode='nearest')
    rows = np.where(np.abs(rows - usual) > SPIKE, usual, rows)
    readings = _Readings.of(rows[: size * every].reshape(size, every), kelvin)
    noise, course, root = readings.likeliest()
    if noise > LARGEST_NOISE:
        return None
    middles = np.arange(size, dtype=float) * every + 0.5 * (every - 1)
    beyond = course - np.clip(course, 0.0, last)
    values = np.interp(course, np.arange(last + 1), levels) + kelvin * beyond
    return CoarseCourse(middles, values, np.asarray(root / kelvin), kelvin)


def _is_read_seldom(changes: IntArray) -> bool:
    """Tell whether a reading changes every so many rows only: it was not read in between.

    `held_temperature` of a recording finds the time of each measurement, from three rows a
    measurement on; a step that is late by one row of two is no place of a course either.
    """
    apart, counts = np.unique(np.diff(changes), return_counts=True)
    if not len(apart):
        return False
    periods = np.arange(2, MOST_ROWS_A_READING + 1)
    on_time = (apart % periods[:, None] == 0) @ counts
    return bool(on_time.max() > ON_TIME_SHARE * counts.sum())


@dataclass(frozen=True, eq=False)
class _Readings:
    """Means of the counts of several rows, each."""

    means: FloatArray
    """(m,) [counts]."""
    low: FloatArray
    """(m,) the lower one of the two counts that each is a mean of."""
    weight: FloatArray
    """(m, 2) readings of the lower count and of the next; 0 of a mean over many."""
    middle: FloatArray
    """(m,) inverse variance of the temperature about the mean [1/counts²].

    That of a mean over many counts, and for each while a count is held one observation of the
    temperature's mean, whose error is that of rounding.
    """
    count: float
    """Size of a count [K]."""

    @classmethod
    def of(cls, counts: FloatArray, count: float) -> _Readings:
        """Return those of rows (m, every) in counts of `count` [K]."""
        means = counts.mean(axis=1)
        low = np.floor(means)
        share, fine = means - low, np.ptp(counts, axis=1) > LARGEST_SPAN
        weight = counts.shape[1] * np.stack([1.0 - share, share], axis=1)
        weight[fine] = 0.0
        first = np.append(0, np.flatnonzero(np.diff(means)) + 1)
        length = np.diff(first, append=len(means))
        middle = np.repeat(UNIFORM / length, length)
        middle[share > 0.0] = 0.0
        middle[fine] = FINE_NOISE**-2
        return cls(means, low, weight, middle, count)

    def likeliest(self) -> tuple[float, FloatArray, FloatArray]:
        """Return the likeliest noise with its course (m,) and banded Cholesky factor (b, m)."""
        known: dict[tuple[int, int, int, int], tuple[FloatArray, FloatArray, float]] = {}
        best = len(NOISES) - 2, len(DEVIATIONS) // 2, 0, 0
        known[best] = self.fitted(*best)
        here = None
        while best != here:
            here = best
            for move in MOVES:
                noise, deviation, order, settling = (
                    a + b for a, b in zip(here, move, strict=True)
                )
                near = noise, deviation, order % len(ORDERS), settling % len(SETTLING)
                if not (0 <= near[0] < len(NOISES) and 0 <= near[1] < len(DEVIATIONS)):
                    continue
                if near not in known:
                    known[near] = self.fitted(*near, known[here][0])
                if known[near][2] > known[best][2]:
                    best = near
        return NOISES[best[0]], *known[best][:2]

    def fitted(
        self,
        noise: int,
        deviation: int,
        order: int,
        settling: int,
        start: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray, float]:
        """Return the likeliest course (m,), its banded Cholesky factor (b, m) and ln evidence.

        Of a place in NOISES, DEVIATIONS, ORDERS and SETTLING, from another course or as of normal
        noise.
        """
        size = len(self.means)
        settles = settling_differences(
            size, ORDERS[order], SETTLING_K / self.count, SETTLING[settling]
        )
        prior = _Smoothness(ORDERS[order], np.hypot(DEVIATIONS[deviation], settles))
        stiff, sigma = prior.bands(), NOISES[noise]
        damping = UNIFORM * float(self.weight.sum(axis=1).mean())
        if start is None:
            root = _factor(stiff, np.full(size, damping))
            start = cho_solve_banded((root, False), damping * self.means)
        course, value = start, self._log_likelihood(start, sigma) - prior.penalty(start)
        for _ in range(MOST_STEPS):
            slope, curvature = self._derivatives(course, sigma)
            root = _factor(stiff, curvature + damping)
            step = cho_solve_banded((root, False), slope - prior.slope(course))
            further = course + step
            reached = self._log_likelihood(further, sigma) - prior.penalty(further)
            gain = reached - value
            if gain >= 0.0:
                course, value = further, reached
                if gain < CONVERGED and damping < LEAST_DAMPING:
                    break
            damping *= 0.1 if gain >= 0.0 else 10.0
        root = _factor(stiff, self._derivatives(course, sigma)[1])
        free = float(np.log(prior.deviations).sum()) + (SETTLING_COST if settling else 0.0)
        return course, root, value - free - float(np.log(root[-1]).sum())

    def _log_likelihood(self, course: FloatArray, noise: float) -> float:
        total = -0.5 * float((self.middle * (self.means - course) ** 2).sum())
        for k in range(2):
            total += float(self.weight[:, k] @ _bounds(self.low + k - course, noise)[0])
        return total

    def _derivatives(self, course: FloatArray, noise: float) -> tuple[FloatArray, FloatArray]:
        """Return the (m,) slope of the ln likelihood and its curvature, turned to be positive."""
        slope, curvature = self.middle * (self.means - course), self.middle.copy()
        for k in range(2):
            _, first, second = _bounds(self.low + k - course, noise)
            slope += self.weight[:, k] * first
            curvature += self.weight[:, k] * second
        return slope, curvature


@dataclass(frozen=True, eq=False)
class _Smoothness:
    """A prior of courses (m,): their differences of an order are normal."""

    order: int
    deviations: FloatArray
    """(m − order,) of the differences [counts]."""

    def penalty(self, course: FloatArray) -> float:
        """Return −ln of the prior of a course, but for a constant."""
        return 0.5 * float(((np.diff(course, self.order) / self.deviations) ** 2).sum())

    def slope(self, course: FloatArray) -> FloatArray:
        """Return the (m,) slope of the penalty."""
        differences = np.diff(course, self.order) / self.deviations**2
        return np.asarray(np.convolve(differences, difference(self.order)))

    def bands(self) -> FloatArray:
        """Return the upper bands (order + 1, m) of the matrix of the penalty."""
        return penalty_bands(self.order, self.deviations**-2)


def _bounds(offset: FloatArray, noise: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return ln P of a reading `offset` above the temperature T, d ln P/dT and −d² ln P/dT².

    All (m,), in counts.
    """
    low, high = (offset - 0.5) / noise, (offset + 0.5) / noise
    # Mirrored to the left tail, where ln Φ keeps its digits.
    sign = np.where(offset > 0.0, -1.0, 1.0)
    low, high = np.where(sign > 0.0, low, -high), np.where(sign > 0.0, high, -low)
    above, below = log_ndtr(high), log_ndtr(low)
    ln = above + np.log1p(-np.exp(np.minimum(below - above, -1e-16)))
    at_low = np.exp(-0.5 * low**2 - _LN_SQRT_2PI - ln)
    at_high = np.exp(-0.5 * high**2 - _LN_SQRT_2PI - ln)
    slope = (at_low - at_high) / noise
    curvature = slope**2 + (high * at_high - low * at_low) / noise**2
    return ln, sign * slope, np.maximum(curvature, 0.0)


def _factor(stiff: FloatArray, curvature: FloatArray) -> FloatArray:
    bands = stiff.copy()
    bands[-1] += curvature + LEAST_CURVATURE + ROUNDING * stiff[-1]
    return np.asarray(cholesky_banded(bands))
