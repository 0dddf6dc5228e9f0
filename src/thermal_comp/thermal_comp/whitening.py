# SPDX-License-Identifier: Apache-2.0
"""Whiten block means under a noise model: the innovations of its Kalman filter, exact at gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.model import NoiseModel
from thermal_comp.noise_process import ladder_autocovariance

SMALLEST_WHITE_SHARE = 0.02
"""Least share of the variance of a mean that is taken as uncorrelated between means."""


@dataclass(frozen=True, eq=False)
class Gains:
    """What the filter does at each of m block means; it depends on their places alone."""

    power: FloatArray
    """(m, k) decay of each process since the mean before."""
    gain: FloatArray
    """(m, k) share of the innovation each process takes up."""
    deviation: FloatArray
    """(m,) standard deviation of the innovation [unit]."""


def whiten(
    values: FloatArray, slot: IntArray, noise: NoiseModel, axis: int, period: float
) -> FloatArray:
    """Return the whitened rows (m, q): uncorrelated and of unit variance under the noise model.

    `values` (m, q) are block means of one run, free of NaN, at the places `slot` (m,) of a
    uniform grid of `period` seconds; any columns may be whitened together. The mean of an
    Ornstein-Uhlenbeck process is AR(1) plus white, so the filter is exact, also across gaps.
    """
    return apply_gains(values, innovation_gains(slot, noise, axis, period))


def innovation_gains(slot: IntArray, noise: NoiseModel, axis: int, period: float) -> Gains:
    """Return the gains for block means at `slot`; worth keeping where many columns follow."""
    decay, stationary, white = state_space(noise, axis, period)
    power, gain, deviation = _gains(np.asarray(slot), decay, stationary, white)
    return Gains(power, gain, deviation)


def apply_gains(values: FloatArray, gains: Gains) -> FloatArray:
    """Return the whitened rows (m, q)."""
    whitened: FloatArray = _innovations(
        np.ascontiguousarray(values, dtype=np.float64), gains.power, gains.gain, gains.deviation
    )
    return whitened


def log_determinant(slot: IntArray, noise: NoiseModel, axis: int, period: float) -> float:
    """Return ln det of the covariance of the block means."""
    return 2.0 * float(np.log(innovation_gains(slot, noise, axis, period).deviation).sum())


def state_space(
    noise: NoiseModel, axis: int, period: float
) -> tuple[FloatArray, FloatArray, float]:
    """Return decay (k,) per period, stationary variance (k,) and the variance left over."""
    variance = noise.amplitudes[:, axis] ** 2
    covariance = ladder_autocovariance(noise.time_constants, period, 2)
    decay = np.exp(-period / noise.time_constants)
    stationary = variance * covariance[:, 1] / decay
    total = noise.white[axis] ** 2 / period + variance @ covariance[:, 0]
    white = float(max(total - stationary.sum(), SMALLEST_WHITE_SHARE * total))
    return decay, stationary, white


@njit(cache=True)
def _gains(
    slot: IntArray, decay: FloatArray, stationary: FloatArray, white: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    rows, order = len(slot), len(decay)
    power = np.ones((rows, order))
    gain = np.zeros((rows, order))
    deviation = np.zeros(rows)
    covariance = np.diag(stationary)
    shared = np.zeros(order)
    for i in range(rows):
        if i > 0:
            passed = slot[i] - slot[i - 1]
            for j in range(order):
                power[i, j] = decay[j] ** passed
            for j in range(order):
                for k in range(order):
                    covariance[j, k] *= power[i, j] * power[i, k]
                covariance[j, j] += stationary[j] * (1.0 - power[i, j] ** 2)
        variance = white
        for j in range(order):
            shared[j] = 0.0
            for k in range(order):
                shared[j] += covariance[j, k]
            variance += shared[j]
        for j in range(order):
            gain[i, j] = shared[j] / variance
            for k in range(order):
                covariance[j, k] -= gain[i, j] * shared[k]
        deviation[i] = np.sqrt(variance)
    return power, gain, deviation


@njit(cache=True)
def _innovations(
    values: FloatArray, power: FloatArray, gain: FloatArray, deviation: FloatArray
) -> FloatArray:
    rows, width = values.shape
    order = power.shape[1]
    whitened = np.empty((rows, width))
    state = np.zeros((width, order))
    for i in range(rows):
        for c in range(width):
            expected = 0.0
            for j in range(order):
                state[c, j] *= power[i, j]
                expected += state[c, j]
            innovation = values[i, c] - expected
            for j in range(order):
                state[c, j] += gain[i, j] * innovation
            whitened[i, c] = innovation / deviation[i]
    return whitened
