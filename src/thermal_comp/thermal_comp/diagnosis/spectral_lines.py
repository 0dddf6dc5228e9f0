# SPDX-License-Identifier: Apache-2.0
"""Lines in the spectrum of the fine rows, where block means would alias them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import PreparedRun

MOST_LINES = 3
"""Most lines that are handed on."""
PROMINENCE = 8.0
"""Least ratio of a line's power, summed over runs and axes, to the spectrum around it."""
LOWEST_HZ = 1.0 / 900.0
"""Slower waves belong to the thermal cycle."""


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
