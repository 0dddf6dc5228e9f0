# SPDX-License-Identifier: Apache-2.0
"""Lines in the spectrum of the fine rows, where block means would alias them.

The clock that paces a sensor feels its temperature, and the alias of a steady frequency moves with
it: f = f₀ + d · (T − T_ref). Lines that stand still are peaks of the spectrum. Those that move are
looked for in two steps: the powers of short windows are added up along f for every f₀ and d (a
Hough transform), then the rows are turned back by the phase of the best, and of the highest peak,
and averaged: where d is right the spectrum of what is left has its highest peak (dechirping).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from imu_recording.recording import FloatArray
from numpy.lib.stride_tricks import sliding_window_view
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import maximum_filter1d

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.kept_results import kept
from thermal_comp.data.prepared_run import PreparedRun

MOST_LINES = 3
"""Most lines that are returned."""
LEAST_PROMINENCE = 8.0
"""Least ratio of a line's power, summed over runs and axes, to the spectrum around it."""
LOWEST_HZ = 1.0 / 900.0
"""Lowest frequency of a line [Hz]: slower waves belong to the thermal cycle …"""
LOWEST_HARMONIC = 8.0
"""… as do those up to so many times as fast as the temperature goes to and fro: it has corners."""
LEAST_PERIODS = 20.0
"""Periods of a line in the longest run, at least: fewer are a course over time."""
LEAST_ROWS, MOST_ROWS = 200, 1 << 21
"""Least and greatest number of rows, missing ones counted, that a spectrum is made of."""
WINDOW_ROWS = 256
"""Length of the windows in which a moving line is taken to be constant [rows]."""
SLOW_BINS = 2
"""Lowest bins of such a window, which belong to the thermal cycle."""
LARGEST_WINDOW_POWER = 30.0
"""Largest power of a window that counts, over the median around it: a spike or a step is in one
window alone."""
LARGEST_DRIFT_HZ_PER_K = 1e-3
"""Largest drift that is looked for [Hz/K]: 50 Hz against a clock of 20 ppm/K."""
LEAST_DRIFT_RATIO = 2.5
"""Least ratio of the prominences of a drifting line and of a constant one. Any drift raises the
prominence of a frequency that wanders, by up to 1.7."""
LEAST_STRONG_SHARE, LARGEST_REST = 0.1, 0.25
"""Share of the power around it from which a constant line is strong, and what a drifting one
leaves, at most, of what the constant one leaves: then it drifts, little as it gains."""
STRONG_LINE_DRIFTS = 81
"""Drifts of a strong line that are tried at a time."""
DRIFT_STEPS = 4
"""Coarse steps of drift on either side of the best that dechirping covers."""
MOST_DRIFTS = 128
"""Most drifts that it tries, as close together as the rows can tell."""
REFINED_STEPS = (0.25, 0.0625)
"""Steps by which the best drift is then refined, in those of dechirping."""
AVERAGED_ROWS = 32
"""Dechirped rows per average: a drift wrong by DRIFT_STEPS turns one average by a quarter."""


class SpectralLine(NamedTuple):
    """One line: its frequency at the reference temperature [Hz] and its drift [Hz/K]."""

    frequency: float
    drift: float


@dataclass(frozen=True, eq=False)
class _Series:
    """The rows of one run at even distances; what is missing is zero."""

    values: FloatArray
    """(n, 3) residual of level, time and temperature."""
    known: FloatArray
    """(n,) one where there is a row, else zero."""
    temperature: FloatArray
    """(n,) difference from the reference [K]."""
    integral: FloatArray
    """(n,) its integral over time [K·s]."""


@kept
def spectral_lines(runs: Sequence[PreparedRun], sensor: Sensor) -> list[SpectralLine]:
    """Return the most prominent lines, strongest first."""
    step = _distance_of_rows(runs)
    if not LEAST_ROWS <= 2 * frequencies_told_apart(runs) < MOST_ROWS:
        return []
    series = [_series(run, sensor, step) for run in runs]
    lowest = max(
        LOWEST_HZ,
        LOWEST_HARMONIC * max(map(_frequency_of_temperature, runs)),
        LEAST_PERIODS / max(float(np.ptp(run.conditions.time)) for run in runs),
    )
    steady = _steady_lines(series, step, lowest)
    moving = _moving_line(series, step, steady[:1], lowest)
    return [*(moving or _strong_line(series, step, steady[:1])), *steady][:MOST_LINES]


def frequencies_told_apart(runs: Sequence[PreparedRun]) -> int:
    """Return the number of frequencies among which a line is the most prominent one.

    They lie 1/T apart up to 1/2Δt in rows Δt apart in the longest run, of T, gaps counted.
    """
    longest = max(float(np.ptp(run.conditions.time)) for run in runs)
    return max(int(0.5 * longest / _distance_of_rows(runs)), 1)


def _frequency_of_temperature(run: PreparedRun) -> float:
    """Return how often the temperature goes to and fro, as a sine of its size and rate [Hz]."""
    temperature = run.smoothed.temperature
    rate = np.gradient(temperature, run.time)
    return float(np.sqrt(np.mean(rate**2)) / (2.0 * np.pi * max(float(temperature.std()), 1e-6)))


def _distance_of_rows(runs: Sequence[PreparedRun]) -> float:
    """Return the usual distance of rows [s]."""
    return float(np.median(np.diff(runs[0].conditions.time)))


def _series(run: PreparedRun, sensor: Sensor, step: float) -> _Series:
    """Return a run's rows of one sensor at even distances of `step` [s]."""
    fine = run.conditions
    slot = np.rint((fine.time - fine.time[0]) / step).astype(int)
    temperature = fine.temperature_difference
    values = np.zeros((slot[-1] + 1, 3))
    values[slot] = _detrended(run.fine_measured[sensor], temperature)
    known = np.zeros(len(values))
    known[slot] = 1.0
    integral = cumulative_trapezoid(temperature, fine.time, initial=0.0)
    every = np.arange(len(values))
    return _Series(
        values=values,
        known=known,
        temperature=np.interp(every, slot, temperature),
        integral=np.interp(every, slot, integral),
    )


def _detrended(values: FloatArray, temperature: FloatArray) -> FloatArray:
    """Return the residual of level, time and temperature; zero where a value is missing."""
    known = np.isfinite(values)
    filled = np.where(known, values, np.nanmean(values, axis=0))
    time = np.linspace(-1.0, 1.0, len(filled))
    basis = np.stack([np.ones_like(time), time, temperature - temperature.mean()], axis=1)
    answer, *_ = np.linalg.lstsq(basis, filled, rcond=None)
    return np.where(known, filled - basis @ answer, 0.0)


def _steady_lines(series: Sequence[_Series], step: float, lowest: float) -> list[SpectralLine]:
    """Return the peaks of the spectrum above the `lowest` frequency, most prominent first.

    In rows with gaps, such as bursts, a slow error appears wherever the spectrum of the pattern of
    the rows has a peak, as it is multiplied by that pattern; so much is allowed for.
    """
    size = 1 << (2 * max(len(one.values) for one in series)).bit_length()
    frequency = np.fft.rfftfreq(size, step)
    slow = frequency <= lowest
    power, leaked = np.zeros((2, size // 2 + 1))
    for one in series:
        taper = np.hanning(len(one.values))
        spectrum = np.abs(np.fft.rfft(one.values * taper[:, None], size, axis=0)) ** 2
        spectrum /= np.maximum(np.median(spectrum, axis=0), 1e-300)
        power += spectrum.sum(axis=1)
        pattern = np.abs(np.fft.rfft(one.known * taper, size)) ** 2
        pattern = maximum_filter1d(pattern / pattern[0], 2 * int(slow.sum()) + 1)
        leaked += pattern * spectrum[slow].max(axis=0).sum()
    prominence = np.where(slow, 0.0, power / (_local_median(power) + leaked))
    found = []
    for _ in range(MOST_LINES):
        peak = int(np.argmax(prominence))
        if prominence[peak] < LEAST_PROMINENCE:
            break
        found.append(SpectralLine(_interpolated(power, peak) * float(frequency[1]), 0.0))
        prominence[max(0, peak - 12) : peak + 13] = 0.0
    return found


def _moving_line(
    series: Sequence[_Series], step: float, steady: Sequence[SpectralLine], lowest: float
) -> list[SpectralLine]:
    """Return the likeliest line that follows the temperature, [] where none is prominent."""
    bin_hz = 1.0 / (WINDOW_ROWS * step)
    temperatures = np.concatenate([one.temperature for one in series])
    drift_step = 0.5 * bin_hz / max(float(np.ptp(temperatures)), 1.0)
    span = max(float(np.ptp(_departure_from_line(one.integral))) for one in series)
    reach = DRIFT_STEPS * drift_step
    count = min(int(np.ceil(4.0 * reach * span)) | 1, MOST_DRIFTS + 1)
    offsets = np.linspace(-reach, reach, count) if count > 1 else np.zeros(1)
    found, standing = [], 0.0
    for rough in [*_along_temperature(series, bin_hz, drift_step), *steady]:
        found += _dechirped(series, step, rough, offsets)
        still = SpectralLine(rough.frequency, 0.0)
        standing = max(standing, *(p for p, _ in _dechirped(series, step, still, np.zeros(1))))
    prominence, line = max(found, default=(0.0, SpectralLine(0.0, 0.0)))
    for part in REFINED_STEPS if prominence >= LEAST_PROMINENCE and count > 1 else ():
        about = np.arange(-DRIFT_STEPS, DRIFT_STEPS + 1) * part * (offsets[1] - offsets[0])
        prominence, line = max([(prominence, line), *_dechirped(series, step, line, about)])
    slowest = line.frequency + float((line.drift * temperatures).min())
    prominent = prominence >= max(LEAST_PROMINENCE, LEAST_DRIFT_RATIO * standing)
    return [line] if prominent and line.drift and slowest > lowest else []


def _strong_line(
    series: Sequence[_Series], step: float, steady: Sequence[SpectralLine]
) -> list[SpectralLine]:
    """Return the drifting line that leaves a small part of what a constant one leaves, or [].

    Such a one stands out whether it drifts or not, as it moves while a device warms up alone. The
    rows count in full here: tapered spectra leave out where a recording begins.
    """
    if not steady:
        return []
    temperatures = np.concatenate([one.temperature for one in series])
    standing = best = _most_coherent(series, step, steady[0], np.zeros(1))
    if not LEAST_STRONG_SHARE < standing[0] < 1.0 - LARGEST_REST:
        return []
    width = 4.0 / (WINDOW_ROWS * step * max(float(np.ptp(temperatures)), 1.0))
    for part in (1.0, 0.1, 0.01):
        offsets = np.linspace(-part * width, part * width, STRONG_LINE_DRIFTS)
        best = max(best, _most_coherent(series, step, best[1], offsets))
    return [best[1]] if 1.0 - best[0] < LARGEST_REST * (1.0 - standing[0]) else []


def _most_coherent(
    series: Sequence[_Series], step: float, line: SpectralLine, offsets: FloatArray
) -> tuple[float, SpectralLine]:
    """Return the largest share of the power around a line that one near it has, and that line."""
    averaged = [_averaged(one, step, line, np.ones) for one in series]
    size = 1 << (2 * max(len(values) for values, _ in averaged)).bit_length()
    whole = sum(len(values) * float((np.abs(values) ** 2).sum()) for values, _ in averaged)
    best = 0.0, line
    for offset in offsets.tolist():
        power = np.zeros(size)
        for values, integral in averaged:
            turned = values * np.exp(-2j * np.pi * offset * integral)[:, None]
            power += (np.abs(np.fft.fft(turned, size, axis=0)) ** 2).sum(axis=1)
        ordered = np.fft.fftshift(power)
        peak = int(np.argmax(ordered))
        away = (_interpolated(ordered, peak) - size // 2) / (size * AVERAGED_ROWS * step)
        share = float(ordered[peak]) / max(whole, 1e-300)
        best = max(best, (share, SpectralLine(line.frequency + away, line.drift + offset)))
    return best


def _along_temperature(
    series: Sequence[_Series], bin_hz: float, drift_step: float
) -> list[SpectralLine]:
    """Return the line along which windows have most power, where it moves at all."""
    windows = [_windows(one) for one in series]
    powers = np.concatenate([power for power, _ in windows])
    temperature = np.concatenate([t for _, t in windows])
    if not len(powers):
        return []
    count = int(LARGEST_DRIFT_HZ_PER_K / drift_step)
    rows = np.arange(len(powers))
    shifted = sliding_window_view(np.concatenate([powers] * 2, axis=1), WINDOW_ROWS // 2, axis=1)
    best = 0.0, 0, 0
    for number in range(-count, count + 1):
        shift = np.rint(number * drift_step * temperature / bin_hz).astype(int)
        total = shifted[rows, shift % WINDOW_ROWS].sum(axis=0)
        best = max(best, (float(total.max()), number, int(np.argmax(total))))
    _, number, peak = best
    return [SpectralLine(peak * bin_hz, number * drift_step)] if number else []


def _windows(one: _Series) -> tuple[FloatArray, FloatArray]:
    """Return (w, WINDOW_ROWS) powers over their median and (w,) temperatures of windows.

    They overlap by half; those that lie in gaps are left out.
    """
    starts = np.arange(0, len(one.values) - WINDOW_ROWS + 1, WINDOW_ROWS // 2)
    rows = np.add.outer(starts, np.arange(WINDOW_ROWS))
    rows = rows[one.values.any(axis=1)[rows].mean(axis=1) > 0.5]
    if not len(rows):
        return np.zeros((0, WINDOW_ROWS)), np.zeros(0)
    tapered = one.values[rows] * np.hanning(WINDOW_ROWS)[:, None]
    power = np.abs(np.fft.fft(tapered, axis=1)) ** 2
    usual = np.median(power, axis=(0, 1))
    relative = (power / np.maximum(usual, 1e-300)).sum(axis=2)
    around = np.median(relative, axis=0)
    relative = np.minimum(relative / np.maximum(around, 1e-300), LARGEST_WINDOW_POWER)
    relative[:, : SLOW_BINS + 1] = relative[:, -SLOW_BINS:] = 1.0
    return relative, one.temperature[rows].mean(axis=1)


def _dechirped(
    series: Sequence[_Series], step: float, line: SpectralLine, offsets: FloatArray
) -> list[tuple[float, SpectralLine]]:
    """Return prominence and line of the highest peak for every drift near that of a line."""
    averaged = [_averaged(one, step, line) for one in series]
    rows = max(len(values) for values, _ in averaged)
    size = 1 << (2 * rows).bit_length()
    found = []
    for offset in offsets.tolist():
        power = np.zeros(size)
        for values, integral in averaged:
            turned = values * np.exp(-2j * np.pi * offset * integral)[:, None]
            spectrum = np.abs(np.fft.fft(turned, size, axis=0)) ** 2
            power += (spectrum / np.maximum(np.median(spectrum, axis=0), 1e-300)).sum(axis=1)
        ordered = np.fft.fftshift(power)
        peak = size // 4 + int(np.argmax(ordered[size // 4 : size - size // 4]))
        away = (_interpolated(ordered, peak) - size // 2) / (size * AVERAGED_ROWS * step)
        better = SpectralLine(line.frequency + away, line.drift + offset)
        found.append((float(ordered[peak] / np.median(ordered)), better))
    return found


def _averaged(
    one: _Series,
    step: float,
    line: SpectralLine,
    taper: Callable[[int], FloatArray] = np.hanning,
) -> tuple[FloatArray, FloatArray]:
    """Return (k, 3) averages of the rows without the phase of a line, tapered, and integrals."""
    count = len(one.values) // AVERAGED_ROWS
    rows = np.arange(count * AVERAGED_ROWS)
    turns = line.frequency * step * rows + line.drift * one.integral[rows]
    turned = one.values[rows] * np.exp(-2j * np.pi * turns)[:, None]
    averages = turned.reshape(count, AVERAGED_ROWS, 3).mean(axis=1)
    integral = one.integral[rows].reshape(count, AVERAGED_ROWS).mean(axis=1)
    return averages * taper(count)[:, None], integral


def _departure_from_line(integral: FloatArray) -> FloatArray:
    """Return an integral less a straight line: the part that shows a drift."""
    place = np.linspace(-1.0, 1.0, len(integral))
    return np.asarray(integral - np.polyval(np.polyfit(place, integral, 1), place))


def _local_median(power: FloatArray, width: int = 301) -> FloatArray:
    """Return the median of blocks of `width` frequencies, interpolated."""
    count = max(len(power) // width, 1)
    blocks = np.array_split(power, count)
    centres = np.cumsum([len(b) for b in blocks]) - 0.5 * np.array([len(b) for b in blocks])
    return np.asarray(np.interp(np.arange(len(power)), centres, [np.median(b) for b in blocks]))


def _interpolated(power: FloatArray, peak: int) -> float:
    """Return the place of a peak between bins, by a parabola through the logarithms."""
    if not 0 < peak < len(power) - 1:
        return float(peak)
    before, here, after = np.log(power[peak - 1 : peak + 2])
    return float(peak + 0.5 * (before - after) / (before - 2.0 * here + after))
