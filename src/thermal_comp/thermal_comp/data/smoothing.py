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
from dataclasses import replace
from itertools import pairwise
from typing import TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from scipy.fft import dct, next_fast_len
from scipy.interpolate import Akima1DInterpolator, CubicHermiteSpline

from thermal_comp.data.adaptive_spline import adaptive_spline
from thermal_comp.data.coarse_thermometer import CoarseCourse, coarse_course
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
MOST_ERRORS_OF_COUNTS = 24
"""Directions in which a temperature between counts is taken to be unknown."""
MARGIN_WIDTHS = 8.0
"""Length of the mirror image at either end, in widths: what lies beyond changes nothing."""
LONG_GAP_STEPS = 20.0
"""Steps of a gap from which the temperature before and after it is smoothed by itself."""


Courses: TypeAlias = list[tuple[IntArray, FloatArray, CoarseCourse]]
"""Rows of pieces of a temperature, their places in its course between counts, and that course."""


def smoothed_conditions(conditions: Conditions) -> tuple[Conditions, IntArray]:
    """Return conditions with the temperature smoothed, and where in them the given rows are.

    They have further rows between bursts, so that what has a memory of the temperature sees its
    course there. Kept as long as the conditions are.
    """
    smoothed, row, _ = _smoothed_with_courses(conditions)
    return smoothed, row


def _smoothed_with_courses(conditions: Conditions) -> tuple[Conditions, IntArray, Courses]:
    if conditions not in _SMOOTHED:
        time = conditions.time
        if bursts := _bursts(time):
            between = _between_bursts(time, bursts)
            longer = conditions.at(np.sort(np.concatenate([time, between])))
            temperature = _through_bursts(conditions, bursts, longer.time)
            row = np.arange(len(time)) + np.searchsorted(between, time)
            _SMOOTHED[conditions] = replace(longer, temperature=temperature), row, []
        else:
            smooth, courses = _smoothed(
                time,
                conditions.temperature,
                conditions.temperature_interval,
                conditions.temperature_counts,
            )
            rows = np.arange(len(time))
            _SMOOTHED[conditions] = replace(conditions, temperature=smooth), rows, courses
    return _SMOOTHED[conditions]


_SMOOTHED: WeakKeyDictionary[Conditions, tuple[Conditions, IntArray, Courses]] = (
    WeakKeyDictionary()
)


def smoothed_temperature(
    time: FloatArray,
    temperature: FloatArray,
    interval: float = 0.0,
    counts: Sequence[float] = (),
) -> FloatArray:
    """Return the (n,) temperature without its thermometer's noise; `time` (n,) ascends [s].

    `interval`: time between measurements [s] that straight lines join; 0: each row is one. Rows on
    such lines have less noise from one to the next than the measurements have. `counts`: those of
    the thermometer, where rows are means of several measurements [°C].
    """
    return _smoothed(time, temperature, interval, counts)[0]


def _smoothed(
    time: FloatArray, temperature: FloatArray, interval: float, counts: Sequence[float]
) -> tuple[FloatArray, Courses]:
    pieces, step = _pieces(time)
    longest = max(pieces, key=len)
    if len(longest) < LEAST_ROWS or np.ptp(temperature) == 0.0:
        return temperature, []
    smoothed, courses = temperature.copy(), []
    every = max(round(interval / step), 1)
    width = _width(temperature[longest][::every], every * step)
    for rows in pieces:
        values = temperature[rows]
        if len(rows) < LEAST_ROWS:
            continue
        course = coarse_course(values[::every], counts)
        if course is not None:
            places = np.arange(len(rows)) / every
            smoothed[rows] = course.at(places)
            courses.append((rows, places, course))
            continue
        adapted = adaptive_spline(values, width / step, every)
        smoothed[rows] = _spline(values, width / step) if adapted is None else adapted
    return smoothed, courses


def errors_between_counts(conditions: Conditions) -> FloatArray:
    """Return (n, e) what a coarse thermometer leaves unknown, one deviation each [K].

    The largest over all pieces between gaps; (n, 0) of a fine one. Kept as long as the conditions.
    """
    if conditions not in _BETWEEN_COUNTS:
        courses = _smoothed_with_courses(conditions)[2]
        whole = sum(len(rows) for rows, _, _ in courses)
        found = []
        for rows, places, course in courses:
            share = -(-MOST_ERRORS_OF_COUNTS * len(rows) // whole)
            found += [(rows, error) for error in course.errors(places, max(share, 2)).T]
        found.sort(key=lambda one: -float(one[1] @ one[1]))
        errors = np.zeros((len(conditions.time), min(len(found), MOST_ERRORS_OF_COUNTS)))
        for k, (rows, error) in enumerate(found[:MOST_ERRORS_OF_COUNTS]):
            errors[rows, k] = error
        _BETWEEN_COUNTS[conditions] = errors
    return _BETWEEN_COUNTS[conditions]


_BETWEEN_COUNTS: WeakKeyDictionary[Conditions, FloatArray] = WeakKeyDictionary()


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
        smooth = smoothed_temperature(
            time, measured, conditions.temperature_interval, conditions.temperature_counts
        )
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
