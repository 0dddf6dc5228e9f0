# SPDX-License-Identifier: Apache-2.0
"""Means of white noise and Ornstein-Uhlenbeck processes: their autocovariance and draws."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.model import NoiseModel

LADDER = np.geomspace(30.0, 40_000.0, 7)
"""Correlation times [s] of the processes whose sum approximates flicker noise."""


def ladder_autocovariance(time_constants: FloatArray, period: float, lags: int) -> FloatArray:
    """(k, lags) autocovariance of means over `period` of processes of unit variance.

    γ(0) = 2 (r − 1 + e^{−r}) / r²,  γ(m) = ((1 − e^{−r}) / r)² e^{−r (m − 1)},  r = period / τ.
    """
    r = (period / time_constants)[:, None]
    m = np.arange(lags)[None, :]
    covariance: FloatArray = (np.expm1(-r) / r) ** 2 * np.exp(-r * (m - 1))
    covariance[:, 0] = (2.0 * (r + np.expm1(-r)) / r**2)[:, 0]
    return covariance


def mean_autocovariance(noise: NoiseModel, axis: int, period: float, lags: int) -> FloatArray:
    """(lags,) autocovariance of means over `period` seconds of one axis [unit²]."""
    ladder = ladder_autocovariance(noise.time_constants, period, lags)
    covariance: FloatArray = noise.amplitudes[:, axis] ** 2 @ ladder
    covariance[0] += noise.white[axis] ** 2 / period
    return covariance


def toeplitz_product(covariance: FloatArray, slot: IntArray, values: FloatArray) -> FloatArray:
    """Return S @ values, (m, q), where S[i, j] = covariance[|slot_i − slot_j|]."""
    length = int(slot[-1]) + 1
    size = 1 << (2 * length - 1).bit_length()
    kernel = np.zeros(size)
    kernel[:length] = covariance[:length]
    kernel[-(length - 1) :] = covariance[1:length][::-1]
    padded = np.zeros((size, values.shape[1]))
    padded[slot] = values
    spectrum = np.fft.rfft(kernel).real[:, None]
    product: FloatArray = np.fft.irfft(spectrum * np.fft.rfft(padded, axis=0), size, axis=0)[slot]
    return product


def draw_noise(
    noise: NoiseModel, slot: IntArray, period: float, rng: np.random.Generator
) -> FloatArray:
    """Return one draw (m, 3) of the noise of means over `period` at the given slots."""
    length = int(slot[-1]) + 1
    drawn = np.empty((len(slot), 3))
    for axis in range(3):
        covariance = mean_autocovariance(noise, axis, period, length + 1)
        circle = np.concatenate([covariance, covariance[-2:0:-1]])
        spectrum = np.sqrt(np.maximum(np.fft.rfft(circle).real, 0.0))
        white = rng.standard_normal(len(circle))
        drawn[:, axis] = np.fft.irfft(spectrum * np.fft.rfft(white), len(circle))[slot]
    return drawn
