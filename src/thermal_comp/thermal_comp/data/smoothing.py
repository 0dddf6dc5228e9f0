# SPDX-License-Identifier: Apache-2.0
"""The temperature behind a noisy, quantised thermometer: a smoothing spline as stiff as is likely.

The rate of the air's temperature wanders as a random walk, and a die follows it behind its
package: the spectrum is r s / ω⁶ beside the white noise s of the thermometer. The best estimate
of such a temperature is a smoothing spline, f = argmin Σ (y − f)² + λ ∫ f‴² dt, λ = 1 / (r Δt)
(Wahba, Spline Models for Observational Data, 1990, ch. 1); so is that of its rate. r follows
from the spectrum by Whittle's likelihood.
"""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np
from imu_recording.recording import FloatArray
from scipy.fft import dct, next_fast_len

from thermal_comp.data.conditions import Conditions

SHORTEST_WIDTH_S, LONGEST_WIDTH_S = 1.0, 3600.0
"""Least and greatest width r^−⅙ over which a spline smooths [s]."""
LEAST_ROWS = 8
"""Rows of a piece between gaps, below which it stays as it was measured."""
MARGIN_WIDTHS = 8.0
"""Length of the mirror image at either end, in widths: what lies beyond changes nothing."""
LONG_GAP_STEPS = 20.0
"""Steps of a gap from which the temperature before and after it is smoothed by itself."""


def smoothed_conditions(conditions: Conditions) -> Conditions:
    """Return conditions with the temperature smoothed; kept, as long as the conditions are."""
    if conditions not in _SMOOTHED:
        temperature = smoothed_temperature(conditions.time, conditions.temperature)
        _SMOOTHED[conditions] = replace(conditions, temperature=temperature)
    return _SMOOTHED[conditions]


_SMOOTHED: WeakKeyDictionary[Conditions, Conditions] = WeakKeyDictionary()


def smoothed_temperature(time: FloatArray, temperature: FloatArray) -> FloatArray:
    """Return the (n,) temperature without its thermometer's noise; `time` (n,) ascends [s]."""
    steps = np.diff(time)
    step = float(np.median(steps)) if len(steps) else 1.0
    gaps = np.flatnonzero(steps > LONG_GAP_STEPS * step) + 1
    pieces = np.split(np.arange(len(time)), gaps)
    longest = max(pieces, key=len)
    if len(longest) < LEAST_ROWS or np.ptp(temperature) == 0.0:
        return temperature
    width = _width(temperature[longest], step)
    smoothed = temperature.copy()
    for rows in pieces:
        if len(rows) >= LEAST_ROWS:
            smoothed[rows] = _spline(temperature[rows], width / step)
    return smoothed


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
