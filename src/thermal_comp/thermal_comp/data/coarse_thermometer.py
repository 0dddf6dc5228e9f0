# SPDX-License-Identifier: Apache-2.0
"""The temperature behind a thermometer whose counts are coarser than its noise.

A reading y says that T + noise was within half a count of it, no more: ln P(y | T) =
ln [Φ((y + q/2 − T)/σ) − Φ((y − q/2 − T)/σ)]. While it stays within a count the temperature is told
by the instants at which it went from one count to the next, and by how smooth it is: the third
differences are normal with one deviation ρ (a smoothing spline, Wahba, Spline Models for
Observational Data, 1990, ch. 1). The likeliest course is found by Newton's method, σ and ρ by the
marginal likelihood in Laplace's approximation (Rasmussen and Williams, Gaussian Processes for
Machine Learning, 2006, sec. 3.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.sparse.linalg import LinearOperator, eigsh
from scipy.special import log_ndtr

LEAST_HELD_SHARE = 0.5
"""Share of rows that repeat the one before, from which the noise is below the counts."""
LEAST_HELD_ROWS = 3
"""Rows that are alike, from which they are a count, no mean of several."""
MOST_ROWS_A_READING, ON_TIME_SHARE = 120, 0.95
"""Rows between two readings that are written into every row, at most, and share of the changes
that come after whole numbers of them."""
LEAST_MEANS, MOST_MEANS = 40, 4000
"""Number of means of rows that a course is fitted to."""
MEANS_OF, LEAST_COUNT_SHARE = (10, 5, 4, 3, 2, 1), 0.9
"""Readings in a row whose mean may be held by chance, and share of the rows held that are none."""
LARGEST_SPAN = 1.5
"""Counts a mean extends over, from which it is as good as one of a fine thermometer."""
FINE_NOISE = 0.1
"""Noise of such a mean [counts]."""
NOISES = tuple(np.geomspace(0.000625, 0.32, 10).tolist())
"""Noise of a reading [counts]."""
BENDS = tuple(np.geomspace(1e-7, 1.0, 15).tolist())
"""Deviations of the third differences [counts]."""
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
_THIRD_DIFFERENCE: FloatArray = np.array([-1.0, 3.0, -3.0, 1.0])


@dataclass(frozen=True, eq=False)
class CoarseCourse:
    """The likeliest course of a temperature, and how far it may be from it."""

    middles: FloatArray
    """(m,) places of the means it was fitted to [rows]."""
    values: FloatArray
    """(m,) the course there [K]."""
    root: FloatArray
    """(4, m) banded Cholesky factor of its inverse covariance [1/K²]."""
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


def coarse_course(temperature: FloatArray) -> CoarseCourse | None:
    """Return the course behind readings (n,) at equal distances; None where noise is the larger.

    A row between two counts is a mean of readings of both.
    """
    levels = _levels(temperature)
    every = -(-len(temperature) // MOST_MEANS)
    size = len(temperature) // max(every, 1)
    if len(levels) < 2 or size < LEAST_MEANS:
        return None
    counts = np.interp(temperature, levels, np.arange(len(levels)))
    readings = _Readings.of(counts[: size * every].reshape(size, every))
    noise, course, root = readings.likeliest()
    if noise == NOISES[-1]:
        return None
    middles = np.arange(size, dtype=float) * every + 0.5 * (every - 1)
    last = len(levels) - 1
    kelvin = float(levels[-1] - levels[0]) / last
    beyond = course - np.clip(course, 0.0, last)
    values = np.interp(course, np.arange(last + 1), levels) + kelvin * beyond
    return CoarseCourse(middles, values, np.asarray(root / kelvin), kelvin)


def _levels(temperature: FloatArray) -> FloatArray:
    """Return the ascending counts of a thermometer [K], those it skipped included.

    Empty of one whose noise is above its counts.
    """
    change = np.flatnonzero(np.diff(temperature))
    repeated = len(temperature) - len(change)
    if repeated < LEAST_HELD_SHARE * len(temperature) or _is_read_seldom(change):
        return np.zeros(0)
    first = np.append(0, change + 1)
    length = np.diff(first, append=len(temperature))
    held = length >= LEAST_HELD_ROWS
    found, place = np.unique(np.round(temperature[first[held]], 6), return_inverse=True)
    if len(found) < 2:
        return np.zeros(0)
    rows = np.bincount(place, length[held])
    least = float(np.diff(found).min())
    counts = np.rint((found - found[np.argmax(rows)]) / least).astype(int)
    # The largest count whose multiples most readings are: others are means of two by chance.
    for most in MEANS_OF:
        is_count = counts % most == 0
        if is_count.sum() > 1 and rows[is_count].sum() >= LEAST_COUNT_SHARE * rows.sum():
            break
    found, counts = found[is_count], counts[is_count] // most
    inside = np.interp(np.arange(counts[0], counts[-1] + 1), counts, found)
    kelvin = float(inside[-1] - inside[0]) / (len(inside) - 1)
    below = int(np.ceil(max(inside[0] - float(temperature.min()), 0.0) / kelvin))
    above = int(np.ceil(max(float(temperature.max()) - inside[-1], 0.0) / kelvin))
    lower = inside[0] - kelvin * np.arange(below, 0, -1)
    upper = inside[-1] + kelvin * np.arange(1, above + 1)
    return np.concatenate([lower, inside, upper])


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
    """(m, 2) readings of the lower count and of the next."""
    fine: NDArray[np.bool_]
    """(m,) those over so many counts that rounding is no matter."""

    @classmethod
    def of(cls, counts: FloatArray) -> _Readings:
        """Return those of rows (m, every)."""
        means = counts.mean(axis=1)
        low = np.floor(means)
        share = means - low
        weight = counts.shape[1] * np.stack([1.0 - share, share], axis=1)
        return cls(means, low, weight, np.ptp(counts, axis=1) > LARGEST_SPAN)

    def likeliest(self) -> tuple[float, FloatArray, FloatArray]:
        """Return the likeliest noise with its course (m,) and banded Cholesky factor (4, m)."""
        best = len(NOISES) - 2, len(BENDS) // 2
        known = {best: self.fitted(NOISES[best[0]], BENDS[best[1]], self.means)}
        while True:
            here = best
            for noise, bend in ((0, -1), (0, 1), (-1, 0), (1, 0)):
                near = here[0] + noise, here[1] + bend
                inside = 0 <= near[0] < len(NOISES) and 0 <= near[1] < len(BENDS)
                if inside and near not in known:
                    start = known[here][0]
                    known[near] = self.fitted(NOISES[near[0]], BENDS[near[1]], start)
                if inside and known[near][2] > known[best][2]:
                    best = near
            if best == here:
                return NOISES[best[0]], *known[best][:2]

    def fitted(
        self, noise: float, bend: float, start: FloatArray
    ) -> tuple[FloatArray, FloatArray, float]:
        """Return the likeliest course (m,), its banded Cholesky factor (4, m) and ln evidence."""
        stiff = _stiffness(len(start), bend)
        course, damping = start, UNIFORM * float(self.weight.sum(axis=1).mean())
        if start is self.means:  # as if the rounding were normal noise
            root = _factor(stiff, np.full(len(start), damping))
            course = cho_solve_banded((root, False), damping * start)
        value = self._objective(course, noise, bend)
        for _ in range(MOST_STEPS):
            slope, curvature = self._derivatives(course, noise)
            root = _factor(stiff, curvature + damping)
            step = cho_solve_banded((root, False), slope - _third_sum(course, bend))
            reached = self._objective(course + step, noise, bend)
            gain = reached - value
            if gain >= 0.0:
                course, value = course + step, reached
                if gain < CONVERGED and damping < LEAST_DAMPING:
                    break
            damping *= 0.1 if gain >= 0.0 else 10.0
        root = _factor(stiff, self._derivatives(course, noise)[1])
        evidence = value - (len(course) - 3) * np.log(bend) - float(np.log(root[3]).sum())
        return course, root, evidence

    def _objective(self, course: FloatArray, noise: float, bend: float) -> float:
        """Return ln of the likelihood and of the prior of a course."""
        total = -0.5 * float(((np.diff(course, 3) / bend) ** 2).sum())
        total -= 0.5 * float((((self.means - course)[self.fine] / FINE_NOISE) ** 2).sum())
        for k in range(2):
            ln = _bounds(self.low + k - course, noise)[0]
            total += float((self.weight[:, k] * ln)[~self.fine].sum())
        return total

    def _derivatives(self, course: FloatArray, noise: float) -> tuple[FloatArray, FloatArray]:
        """Return the (m,) slope of the ln likelihood and its curvature, turned to be positive."""
        slope, curvature = np.zeros((2, len(course)))
        for k in range(2):
            _, first, second = _bounds(self.low + k - course, noise)
            slope += self.weight[:, k] * first
            curvature += self.weight[:, k] * second
        slope[self.fine] = (self.means - course)[self.fine] / FINE_NOISE**2
        curvature[self.fine] = FINE_NOISE**-2
        return slope, curvature


def _bounds(offset: FloatArray, noise: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return ln P of a reading `offset` above the temperature, −d/dT², d/dT of it [counts]."""
    low, high = (offset - 0.5) / noise, (offset + 0.5) / noise
    # Mirrored to the left tail, where ln Φ keeps its digits.
    sign = np.where(offset > 0.0, -1.0, 1.0)
    low, high = np.where(sign > 0.0, low, -high), np.where(sign > 0.0, high, -low)
    above, below = log_ndtr(high), log_ndtr(low)
    ln = above + np.log1p(-np.exp(np.minimum(below - above, -1e-300)))
    at_low = np.exp(-0.5 * low**2 - _LN_SQRT_2PI - ln)
    at_high = np.exp(-0.5 * high**2 - _LN_SQRT_2PI - ln)
    slope = (at_low - at_high) / noise
    curvature = slope**2 + (high * at_high - low * at_low) / noise**2
    return ln, sign * slope, np.maximum(curvature, 0.0)


def _third_sum(course: FloatArray, bend: float) -> FloatArray:
    """Return (m,) the slope of the prior's penalty."""
    third = np.diff(course, 3) / bend**2
    return np.asarray(np.convolve(third, _THIRD_DIFFERENCE))


def _stiffness(size: int, bend: float) -> FloatArray:
    """Return the upper bands (4, m) of the penalty's matrix."""
    bands = np.zeros((4, size))
    for row, one in enumerate(_THIRD_DIFFERENCE):
        for column in range(row, 4):
            product = one * _THIRD_DIFFERENCE[column] / bend**2
            bands[3 - (column - row), column : column + size - 3] += product
    return bands


def _factor(stiff: FloatArray, curvature: FloatArray) -> FloatArray:
    bands = stiff.copy()
    bands[3] += curvature + LEAST_CURVATURE + ROUNDING * stiff[3]
    return np.asarray(cholesky_banded(bands))
