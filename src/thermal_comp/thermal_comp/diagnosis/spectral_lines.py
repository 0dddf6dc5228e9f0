# SPDX-License-Identifier: Apache-2.0
"""Lines in the spectrum of the fine rows, where block means would alias them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import PreparedRun

MOST_LINES = 3
"""Most lines that are handed on."""
PROMINENCE = 8.0
"""Least ratio of a line's power, summed over runs and axes, to the spectrum around it."""
LOWEST_HZ = 1.0 / 900.0
"""Slower waves belong to the thermal cycle."""
WINDOW_S = 300.0
"""A line is steady or not over windows of this length [s], three of its periods at least."""
FEWEST_WINDOWS = 4
"""A run of fewer windows says nothing about steadiness."""
NOISE_OFFSETS = (-3.0, -2.0, 2.0, 3.0)
"""Where the noise beside a line is taken, in frequencies that a window resolves."""


def spectral_lines(runs: Sequence[PreparedRun], sensor: Sensor) -> list[float]:
    """Return the frequencies [Hz] of the most prominent lines, strongest first."""
    rows = [run.fine_measured[sensor] for run in runs]
    step = float(np.median(np.diff(runs[0].conditions.time)))
    length = min(len(values) for values in rows)
    if length < 200:
        return []
    size = 1 << (2 * length).bit_length()
    power: FloatArray = np.zeros(size // 2 + 1)
    for run, values in zip(runs, rows, strict=True):
        residual = _detrended(values[:length], run.conditions.temperature[:length])
        spectrum = np.abs(np.fft.rfft(residual * np.hanning(length)[:, None], size, axis=0)) ** 2
        power += (spectrum / np.maximum(np.median(spectrum, axis=0), 1e-300)).sum(axis=1)
    frequency = np.fft.rfftfreq(size, step)
    prominence = np.where(frequency > LOWEST_HZ, power / _surroundings(power), 0.0)
    found: list[float] = []
    for _ in range(MOST_LINES):
        peak = int(np.argmax(prominence))
        if prominence[peak] < PROMINENCE:
            break
        found.append(_interpolated(power, peak) * float(frequency[1]))
        prominence[max(0, peak - 12) : peak + 13] = 0.0
    return found


def steadiness(runs: Sequence[PreparedRun], sensor: Sensor, frequency: float) -> float:
    """Return the share of a line's power that one amplitude and phase per run and axis has.

    With z_w the mean of residual · exp(−2πift) over window w and v its variance by noise, taken
    beside the line, the share is Σ (K |⟨z⟩|² − v) / Σ (|z_w|² − v), in units of v: 1 for a
    steady line, near 0 for one whose frequency moves; 1 as well where runs are too short.
    """
    steady = whole = 0.0
    length = max(WINDOW_S, 3.0 / frequency)
    for run in runs:
        time = run.conditions.time
        residual = _detrended(run.fine_measured[sensor], run.conditions.temperature)
        size = max(round(length / float(np.median(np.diff(time)))), 2)
        if len(time) < FEWEST_WINDOWS * size:
            continue
        line = _phasors(residual, time, frequency, size)
        beside = [_phasors(residual, time, frequency + k / length, size) for k in NOISE_OFFSETS]
        # The median of a power distributed exponentially is ln 2 of its mean.
        noise = np.median(np.abs(np.concatenate(beside)) ** 2, axis=0) / np.log(2.0)
        noise = np.maximum(noise, 1e-300)
        steady += float((len(line) * np.abs(line.mean(axis=0)) ** 2 / noise - 1.0).sum())
        whole += float((np.abs(line) ** 2 / noise - 1.0).sum())
    return steady / whole if whole > 0.0 else 1.0


def _phasors(
    residual: FloatArray, time: FloatArray, frequency: float, size: int
) -> NDArray[np.complex128]:
    """(windows, 3) means of residual · exp(−2πift) over `size` rows each."""
    turned = residual * np.exp(-2j * np.pi * frequency * time)[:, None]
    count = len(turned) // size
    return np.asarray(turned[: count * size].reshape(count, size, -1).mean(axis=1))


def _detrended(values: FloatArray, temperature: FloatArray) -> FloatArray:
    """Residual of level, time, temperature and what varies slower than LOWEST_HZ."""
    filled = np.where(np.isfinite(values), values, np.nanmean(values, axis=0))
    time = np.linspace(-1.0, 1.0, len(filled))
    basis = np.stack([np.ones_like(time), time, temperature - temperature.mean()], axis=1)
    answer, *_ = np.linalg.lstsq(basis, filled, rcond=None)
    return np.asarray(filled - basis @ answer)


def _surroundings(power: FloatArray, width: int = 301) -> FloatArray:
    """Return the median of blocks of `width` frequencies, interpolated."""
    count = max(len(power) // width, 1)
    blocks = np.array_split(power, count)
    centres = np.cumsum([len(b) for b in blocks]) - 0.5 * np.array([len(b) for b in blocks])
    return np.asarray(np.interp(np.arange(len(power)), centres, [np.median(b) for b in blocks]))


def _interpolated(power: FloatArray, peak: int) -> float:
    if not 0 < peak < len(power) - 1:
        return float(peak)
    before, here, after = np.log(power[peak - 1 : peak + 2])
    return float(peak + 0.5 * (before - after) / (before - 2.0 * here + after))
