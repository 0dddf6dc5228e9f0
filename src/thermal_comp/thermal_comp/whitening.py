# SPDX-License-Identifier: Apache-2.0
"""Whiten block means under a noise model: the innovations of its Kalman filter, exact at gaps."""

from __future__ import annotations

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.model import NoiseModel
from thermal_comp.noise_process import ladder_autocovariance

SMALLEST_WHITE_SHARE = 0.02
"""Least share of the variance of a mean that is taken as uncorrelated between means."""


def whiten(
    values: FloatArray, slot: IntArray, noise: NoiseModel, axis: int, period: float
) -> FloatArray:
    """Return the whitened rows (m, q): uncorrelated and of unit variance under the noise model.

    `values` (m, q) are block means of one run, free of NaN, at the places `slot` (m,) of a
    uniform grid of `period` seconds; any columns may be whitened together. The mean of an
    Ornstein-Uhlenbeck process is AR(1) plus white, so the filter is exact, also across gaps.
    """
    decay, stationary, white = state_space(noise, axis, period)
    rows = np.ascontiguousarray(values)
    whitened: FloatArray = _innovations(rows, slot, decay, stationary, white)[0]
    return whitened


def log_determinant(slot: IntArray, noise: NoiseModel, axis: int, period: float) -> float:
    """Return ln det of the covariance of the block means."""
    decay, stationary, white = state_space(noise, axis, period)
    empty = np.zeros((len(slot), 0))
    return float(_innovations(empty, slot, decay, stationary, white)[1])


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
def _innovations(
    values: FloatArray, slot: IntArray, decay: FloatArray, stationary: FloatArray, white: float
) -> tuple[FloatArray, float]:
    rows, width = values.shape
    order = len(decay)
    whitened = np.empty((rows, width))
    state = np.zeros((order, width))
    covariance = np.diag(stationary)
    log_det = 0.0
    for i in range(rows):
        if i > 0:
            passed = slot[i] - slot[i - 1]
            power = decay**passed
            for j in range(order):
                state[j] *= power[j]
                for k in range(order):
                    covariance[j, k] *= power[j] * power[k]
                covariance[j, j] += stationary[j] * (1.0 - power[j] ** 2)
        shared = covariance.sum(axis=1)
        variance = shared.sum() + white
        innovation = values[i] - state.sum(axis=0)
        for j in range(order):
            state[j] += (shared[j] / variance) * innovation
            for k in range(order):
                covariance[j, k] -= shared[j] * shared[k] / variance
        whitened[i] = innovation / np.sqrt(variance)
        log_det += np.log(variance)
    return whitened, log_det
