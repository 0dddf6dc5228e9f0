# SPDX-License-Identifier: Apache-2.0
"""The temperature behind a noisy, quantised thermometer: a smoothing spline as stiff as is likely.

The rate of the air's temperature wanders as a random walk, and a die follows it behind its
package: the spectrum is r s / ω⁶ beside the white noise s of the thermometer. The best estimate
of such a temperature is a smoothing spline, f = argmin Σ (y − f)² + λ ∫ f‴² dt, λ = 1 / (r Δt)
(Wahba, Spline Models for Observational Data, 1990, ch. 1); so is that of its rate. r follows
from the spectrum by Whittle's likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray
from scipy.fft import dct, next_fast_len
from scipy.interpolate import Akima1DInterpolator, CubicHermiteSpline, CubicSpline

from thermal_comp.data.adaptive_spline import adaptive_spline
from thermal_comp.data.conditions import Conditions
from thermal_comp.data.gaps import ends_of_long_gaps

SHORTEST_WIDTH_S, LONGEST_WIDTH_S = 1.0, 3600.0
"""Least and greatest width r^−⅙ over which a spline smooths [s]."""
LEAST_ROWS = 8
"""Rows of a piece between gaps, below which it stays as it was measured."""
LONGEST_BURST_S, LEAST_BURSTS = 1200.0, 4
"""Length of the longest piece below which pieces are bursts [s], and least number of them."""
LONGEST_SHORT_BURST_ROWS = 30
"""Rows of the longest below which bursts tell no rate."""
ROWS_BETWEEN_BURSTS = 5
"""Rows that tell the course between two bursts."""
MOST_ERRORS = 12
"""Gaps between bursts in which the temperature is taken to be unknown: a chamber's course has a
corner or two at each end of a ramp, and is well known between them."""
MARGIN_WIDTHS = 8.0
"""Length of the mirror image at either end, in widths: what lies beyond changes nothing."""
LONGEST_TURN = 6.0
"""Time a reading is held at a turn, over that before or after, up to which a parabola turns there:
one whose top just reaches the next count has 5; what is held for longer is a dwell."""
LARGEST_STEP = 1.5
"""Size of a step, in counts, below which it is one count."""
MOST_ROWS_A_READING, ON_TIME_SHARE = 120, 0.95
"""Rows between two readings that are written into every row, at most, and share of the changes
that come after whole numbers of them."""
LEAST_TURN_ROWS = 10
"""Rows a reading is held, at least, at each of several turns in a row: noise turns faster."""
LEAST_STAIRS = 0.5
"""Share of rows between the steps of a coarse thermometer, from which rounding is its noise: that
is not white, so that it tells no stiffness of single places."""
LONG_GAP_STEPS = 20.0
"""Steps of a gap from which the temperature before and after it is smoothed by itself."""


def smoothed_conditions(conditions: Conditions) -> tuple[Conditions, IntArray]:
    """Return conditions with the temperature smoothed, and where in them the given rows are.

    They have further rows between bursts, so that what has a memory of the temperature sees its
    course there. Kept as long as the conditions are.
    """
    if conditions not in _SMOOTHED:
        time, measured = conditions.time, conditions.temperature
        if bursts := _bursts(time):
            between = _between_bursts(time, bursts)
            longer = conditions.at(np.sort(np.concatenate([time, between])))
            temperature = _through_bursts(conditions, bursts, longer.time)
            row = np.arange(len(time)) + np.searchsorted(between, time)
            _SMOOTHED[conditions] = replace(longer, temperature=temperature), row
        else:
            smooth = smoothed_temperature(time, measured, conditions.temperature_interval)
            _SMOOTHED[conditions] = replace(conditions, temperature=smooth), np.arange(len(time))
    return _SMOOTHED[conditions]


_SMOOTHED: WeakKeyDictionary[Conditions, tuple[Conditions, IntArray]] = WeakKeyDictionary()


def smoothed_temperature(
    time: FloatArray, temperature: FloatArray, interval: float = 0.0
) -> FloatArray:
    """Return the (n,) temperature without its thermometer's noise; `time` (n,) ascends [s].

    `interval`: time between measurements [s] that straight lines join; 0: each row is one. Rows on
    such lines have less noise from one to the next than the measurements have.
    """
    pieces, step = _pieces(time)
    longest = max(pieces, key=len)
    if len(longest) < LEAST_ROWS or np.ptp(temperature) == 0.0:
        return temperature
    smoothed = temperature.copy()
    for rows in pieces:
        smoothed[rows] = _between_steps(temperature[rows])
    every = max(round(interval / step), 1)
    width = _width(smoothed[longest][::every], every * step)
    for rows in pieces:
        if len(rows) >= LEAST_ROWS:
            stairs = float(np.mean(smoothed[rows] != temperature[rows])) > LEAST_STAIRS
            adapted = None if stairs else adaptive_spline(smoothed[rows], width / step, every)
            smoothed[rows] = _spline(smoothed[rows], width / step) if adapted is None else adapted
    return smoothed


def _pieces(time: FloatArray) -> tuple[list[IntArray], float]:
    """Return the rows of each piece between gaps, and the usual distance of rows [s]."""
    steps = np.diff(time)
    step = float(np.median(steps)) if len(steps) else 1.0
    gaps = np.flatnonzero(steps > LONG_GAP_STEPS * step) + 1
    return np.split(np.arange(len(time)), gaps), step


def _bursts(time: FloatArray) -> list[IntArray]:
    """Return the rows of each burst; none where pieces are longer, or few."""
    pieces, step = _pieces(time)
    longest = max(map(len, pieces)) * step
    are_short = longest < LONGEST_BURST_S and not len(ends_of_long_gaps(time))
    return pieces if len(pieces) >= LEAST_BURSTS and are_short else []


def _between_bursts(time: FloatArray, bursts: Sequence[IntArray]) -> FloatArray:
    """Return ROWS_BETWEEN_BURSTS times in each gap [s]."""
    edges = [time[[before[-1], after[0]]] for before, after in pairwise(bursts)]
    return np.concatenate([np.linspace(a, b, ROWS_BETWEEN_BURSTS + 2)[1:-1] for a, b in edges])


def _through_bursts(
    conditions: Conditions, bursts: Sequence[IntArray], there: FloatArray
) -> FloatArray:
    """Return the temperature at times `there`, along a smooth curve through bursts.

    A few seconds tell no rate: it is that of the course from burst to burst, by a spline that
    keeps to straight ramps and to corners (Akima, J. ACM 17, 1970). Longer ones tell it, and the
    curve goes on with it from burst to burst.
    """
    time, measured = conditions.time, conditions.temperature
    if max(map(len, bursts)) >= LONGEST_SHORT_BURST_ROWS:
        smooth = smoothed_temperature(time, measured, conditions.temperature_interval)
        ends = np.concatenate([rows[[0, -1]] for rows in bursts if len(rows) > 1])
        slope = np.gradient(smooth, time)
        inside = np.interp(there, time, smooth)
        between = CubicHermiteSpline(time[ends], smooth[ends], slope[ends])(there)
        return np.where(np.isin(there, time), inside, between)
    middle, mean = _middles(time, bursts), _middles(measured, bursts)
    # Beyond either end it goes on as between the last two, not on a parabola.
    middle, mean = (np.pad(v, 2, mode='reflect', reflect_type='odd') for v in (middle, mean))
    return np.asarray(Akima1DInterpolator(middle, mean)(there))


def _middles(values: FloatArray, bursts: Sequence[IntArray]) -> FloatArray:
    return np.array([values[rows].mean() for rows in bursts])


def errors_between_bursts(conditions: Conditions) -> FloatArray:
    """Return (n, e) the largest errors that smoothed temperatures may have between bursts [K].

    It is a parabola in each gap. A curve that leaves out a burst misses it: at a corner of the
    temperature, which is what it misses most, by twice as much as the curve through all bursts
    misses between them. (n, 0) without bursts.
    """
    time = conditions.time
    there = smoothed_conditions(conditions)[0].time
    bursts = _bursts(time)
    if not bursts:
        return np.zeros((len(there), 0))
    missed = 0.5 * _missed_bursts(conditions, bursts)
    size = np.maximum(missed[1:], missed[:-1])
    gaps = np.argsort(-size, kind='stable')[:MOST_ERRORS]
    begin = np.array([time[bursts[gap][-1]] for gap in gaps])
    end = np.array([time[bursts[gap + 1][0]] for gap in gaps])
    share = (there[:, None] - begin) / (end - begin)
    return np.asarray(4.0 * size[gaps] * np.maximum(share * (1.0 - share), 0.0))


def _missed_bursts(conditions: Conditions, bursts: Sequence[IntArray]) -> FloatArray:
    """(b,) how far a curve through every other burst misses each of those between [K]."""
    middle, mean = (_middles(v, bursts) for v in (conditions.time, conditions.temperature))
    missed = np.zeros(len(bursts))
    for first in (1, 2):
        left_out = np.arange(first, len(bursts) - 1, 2)
        others = [rows for k, rows in enumerate(bursts) if k not in set(left_out.tolist())]
        curve = _through_bursts(conditions, others, np.nextafter(middle[left_out], np.inf))
        missed[left_out] = np.abs(curve - mean[left_out])
    missed[[0, -1]] = missed[[1, -2]]
    return missed


@dataclass(frozen=True, eq=False)
class _Steps:
    """Readings that are held for several rows, and the steps between them."""

    first: IntArray
    """(h,) first row of each reading that is held …"""
    last: IntArray
    """(h,) … and last one."""
    at: FloatArray
    """(h − 1,) place of the steps between them [rows]."""
    low: FloatArray
    """(h − 1,) reading before each step …"""
    high: FloatArray
    """(h − 1,) … and after it."""
    adjacent: NDArray[np.bool_]
    """(h − 1,) whether the readings meet in one row and are one count apart."""

    @classmethod
    def of(cls, values: FloatArray) -> _Steps:
        """Return those of readings (n,); a row that is a mean over a step says where it is."""
        last = np.append(np.flatnonzero(np.diff(values)), len(values) - 1)
        first = np.append(0, last[:-1] + 1)
        held = (last > first) & (not _is_read_seldom(last[:-1]))
        between = np.diff(np.flatnonzero(held)) - 1
        first, last = first[held], last[held]
        low, high = values[first[:-1]], values[first[1:]]
        row = values[np.minimum(last[:-1] + 1, len(values) - 1)]
        share = np.clip((high - row) / np.where(high == low, 1.0, high - low), 0.0, 1.0)
        step, adjacent = np.abs(high - low), between <= 1
        count = step[adjacent & (step > 0.0)].min(initial=np.inf)
        # A reading that is held while several counts go by was not read in between.
        adjacent &= step < LARGEST_STEP * count
        at = last[:-1] + 0.5 + np.where(adjacent, between * share, 0.5 * between)
        return cls(first, last, at, low, high, adjacent)

    @property
    def _onward(self) -> FloatArray:
        """(h + 2,) > 0 between steps of one direction, < 0 at a turn; 0 elsewhere and outside."""
        way = np.where(self.adjacent, np.sign(self.high - self.low), 0.0)
        return np.pad(way[1:] * way[:-1], 2)

    @property
    def onward(self) -> NDArray[np.bool_]:
        """(h,) whether a reading is held between steps of one direction."""
        found: NDArray[np.bool_] = self._onward[1:-1] > 0.0
        return found

    @property
    def known(self) -> NDArray[np.bool_]:
        """(h,) whether the steps around tell the course while a reading is held.

        They do between steps of one direction, and around a turn.
        """
        before, here, after = self._onward[:-2], self._onward[1:-1], self._onward[2:]
        length = np.diff(self.at, prepend=-np.inf, append=np.inf)
        beside = np.pad(length[:-1], (1, 0)), np.pad(length[1:], (0, 1))
        slow = np.minimum(length, np.minimum(*beside)) >= LEAST_TURN_ROWS
        turn = (here < 0.0) & (((before > 0.0) & (after > 0.0)) | slow)
        return self.onward | (turn & (length < LONGEST_TURN * np.maximum(*beside)))

    @property
    def size(self) -> FloatArray:
        """(h,) size of the larger step beside each reading [K]; 0 where none is adjacent."""
        steps = np.where(self.adjacent, np.abs(self.high - self.low), 0.0)
        return np.maximum(np.pad(steps, (1, 0)), np.pad(steps, (0, 1)))


def _is_read_seldom(changes: IntArray) -> bool:
    """Tell whether a reading changes every so many rows only: it was not read in between.

    `held_temperature` of a recording finds the time of each measurement, from three rows a
    measurement on; a step that is late by one row of two is no place of a spline either.
    """
    apart, counts = np.unique(np.diff(changes), return_counts=True)
    if not len(apart):
        return False
    periods = np.arange(2, MOST_ROWS_A_READING + 1)
    on_time = (apart % periods[:, None] == 0) @ counts
    return bool(on_time.max() > ON_TIME_SHARE * counts.sum())


def _between_steps(values: FloatArray) -> FloatArray:
    """Return (n,) values with a smooth course in place of the steps of a coarse thermometer.

    Where a reading goes from one count to the next, the temperature is half-way between them: a
    cubic spline through these instants takes the place of readings that are held. Where steps go
    back and forth, noise and the mean of the counts tell what is between; in a dwell nothing does.
    """
    steps = _Steps.of(values)
    course = values.copy()
    if not len(steps.at):
        return course
    half = 0.5 * steps.size
    for known in np.split(np.arange(len(steps.at)), np.flatnonzero(~steps.known[1:-1]) + 1):
        if len(known) > 1:
            at = steps.at[known]
            rows = np.arange(int(np.ceil(at[0])), int(np.floor(at[-1])) + 1)
            middle = CubicSpline(at, 0.5 * (steps.low[known] + steps.high[known]))(rows)
            held = known[0] + 1 + np.clip(np.searchsorted(at, rows) - 1, 0, len(at) - 2)
            level = steps.high[held - 1]
            course[rows] = np.clip(middle, level - half[held], level + half[held])
    return course


def held_readings(conditions: Conditions, longest: float, count: int) -> list[tuple[slice, float]]:
    """Return where a coarse thermometer says little, and its step there [K].

    They are the first and the last reading that is held, beyond which nothing is known, and
    `count` of more than `longest` seconds: those at turns, then the longest, as the steps around
    tell the temperature's course the better the closer they are.
    """
    steps = _Steps.of(conditions.temperature)
    length = conditions.time[steps.last] - conditions.time[steps.first]
    if len(length):
        length[[0, -1]] = np.inf
    found = np.flatnonzero((steps.size > 0.0) & (length > longest))
    order = np.lexsort([-length[found], steps.onward[found] & np.isfinite(length[found])])
    places = found[order][: count + 2]
    return [(slice(steps.first[k], steps.last[k] + 1), float(steps.size[k])) for k in places]


def _spline(values: FloatArray, width: float) -> FloatArray:
    """Return values at equal distances through a smoothing spline of r^−⅙ = `width` rows.

    Its transfer function is 1 / (1 + (ω width)⁶); the ends are continued by their mirror image
    through the last point.
    """
    margin = min(len(values) - 1, int(np.ceil(MARGIN_WIDTHS * width)))
    ramp = np.linspace(values[0], values[-1], len(values))
    longer = np.pad(values - ramp, margin, mode='reflect', reflect_type='odd')
    size = next_fast_len(len(longer), real=True)
    frequency = 2.0 * np.pi * np.fft.rfftfreq(size)
    spectrum = np.fft.rfft(longer, size) / (1.0 + (width * frequency) ** 6)
    return np.asarray(np.fft.irfft(spectrum, size)[margin : margin + len(values)] + ramp)


def _width(temperature: FloatArray, step: float) -> float:
    """Return the likeliest r^−⅙ [s]; at ω⁶ = r the temperature's spectrum is that of its noise."""
    ramp = np.linspace(temperature[0], temperature[-1], len(temperature))
    power = dct(temperature - ramp, norm='ortho')[1:] ** 2
    frequency = np.pi * np.arange(1, len(temperature)) / (len(temperature) * step)
    widths = np.geomspace(SHORTEST_WIDTH_S, LONGEST_WIDTH_S, 60)
    misfits = []
    steep = frequency**-6.0
    for width in widths:
        shape = 1.0 + width**-6.0 * steep
        noise = max(float((power / shape).mean()), 1e-300)
        misfits.append(len(power) * np.log(noise) + float(np.log(shape).sum()))
    return float(widths[int(np.argmin(misfits))])
