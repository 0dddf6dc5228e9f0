# SPDX-License-Identifier: Apache-2.0
"""Whiten block means under a noise model: the innovations of its Kalman filter, exact at gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.model import NoiseModel


@dataclass(frozen=True, eq=False)
class Gains:
    """What the filter does at each of m block means; it depends on their places alone."""

    decay: FloatArray
    """(k,) decay of each process over one block."""
    weight: FloatArray
    """(k,) weight of a process at a block's start in the mean over it."""
    missed: FloatArray
    """(m, k) decay of each process over the missing blocks before."""
    gain: FloatArray
    """(m, k) share of the innovation each process takes up."""
    deviation: FloatArray
    """(m,) standard deviation of the innovation [unit]."""


def whiten(
    values: FloatArray, slot: IntArray, noise: NoiseModel, axis: int, period: float
) -> FloatArray:
    """Return the whitened rows (m, q): uncorrelated and of unit variance under the noise model.

    `values` (m, q) are block means of one run, free of NaN, at the places `slot` (m,) of a
    uniform grid of `period` seconds; any columns may be whitened together.
    """
    return apply_gains(values, innovation_gains(slot, noise, axis, period))


def innovation_gains(slot: IntArray, noise: NoiseModel, axis: int, period: float) -> Gains:
    """Return the gains for block means at `slot`; worth keeping where many columns follow.

    The filter's states are the processes at the start of a block. With r = T / τ of a process x
    of variance σ², the mean over the block is a·x plus what is left, x_end = φ·x plus what is
    left: φ = e^{−r}, a = (1 − φ) / r, Cov(left, left) = σ² (1 − φ)² / r between the two,
    Var(mean − a·x) = σ² (2 r − 3 + 4 φ − φ²) / r².
    """
    variance = noise.amplitudes[:, axis] ** 2
    r = period / noise.time_constants
    decay = np.exp(-r)
    weight = -np.expm1(-r) / r
    shared = variance * np.expm1(-r) ** 2 / r
    series = 2.0 * r / 3.0 - r**2 / 2.0 + 7.0 * r**3 / 30.0
    exact = (2.0 * r - 3.0 + 4.0 * decay - decay**2) / r**2
    left = float(variance @ np.where(r < 1e-2, series, exact) + noise.white[axis] ** 2 / period)
    missed, gain, deviation = _gains(np.asarray(slot), decay, weight, variance, shared, left)
    return Gains(decay, weight, missed, gain, deviation)


def apply_gains(values: FloatArray, gains: Gains) -> FloatArray:
    """Return the whitened rows (m, q)."""
    whitened: FloatArray = _innovations(
        np.ascontiguousarray(values, dtype=np.float64),
        gains.decay,
        gains.weight,
        gains.missed,
        gains.gain,
        gains.deviation,
    )
    return whitened


def apply_transposed(values: FloatArray, gains: Gains) -> FloatArray:
    """Return Wᵀ @ values, (m, q), where W is the filter: S⁻¹ x = Wᵀ W x."""
    turned: FloatArray = _transposed(
        np.ascontiguousarray(values, dtype=np.float64),
        gains.decay,
        gains.weight,
        gains.missed,
        gains.gain,
        gains.deviation,
    )
    return turned


def log_determinant(slot: IntArray, noise: NoiseModel, axis: int, period: float) -> float:
    """Return ln det of the covariance of the block means."""
    return 2.0 * float(np.log(innovation_gains(slot, noise, axis, period).deviation).sum())


@njit(cache=True)
def _gains(
    slot: IntArray,
    decay: FloatArray,
    weight: FloatArray,
    variance: FloatArray,
    shared: FloatArray,
    left: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    rows, order = len(slot), len(decay)
    missed = np.ones((rows, order))
    gain = np.zeros((rows, order))
    deviation = np.zeros(rows)
    covariance = np.diag(variance)
    for i in range(rows):
        if i > 0 and slot[i] > slot[i - 1] + 1:
            missed[i] = decay ** (slot[i] - slot[i - 1] - 1)
            covariance *= np.outer(missed[i], missed[i])
            for j in range(order):
                covariance[j, j] += variance[j] * (1.0 - missed[i, j] ** 2)
        seen = (covariance * weight).sum(axis=1)
        spread = (weight * seen).sum() + left
        gain[i] = (decay * seen + shared) / spread
        covariance = covariance * np.outer(decay, decay) - np.outer(gain[i], gain[i]) * spread
        for j in range(order):
            covariance[j, j] += variance[j] * (1.0 - decay[j] ** 2)
        deviation[i] = np.sqrt(spread)
    return missed, gain, deviation


@njit(cache=True)
def _innovations(
    values: FloatArray,
    decay: FloatArray,
    weight: FloatArray,
    missed: FloatArray,
    gain: FloatArray,
    deviation: FloatArray,
) -> FloatArray:
    rows, width = values.shape
    order = len(decay)
    whitened = np.empty((rows, width))
    state = np.zeros((order, width))
    for i in range(rows):
        innovation = values[i].copy()
        for j in range(order):
            state[j] *= missed[i, j]
            innovation -= weight[j] * state[j]
        for j in range(order):
            state[j] = decay[j] * state[j] + gain[i, j] * innovation
        whitened[i] = innovation / deviation[i]
    return whitened


@njit(cache=True)
def _transposed(
    values: FloatArray,
    decay: FloatArray,
    weight: FloatArray,
    missed: FloatArray,
    gain: FloatArray,
    deviation: FloatArray,
) -> FloatArray:
    rows, width = values.shape
    order = len(decay)
    turned = np.empty((rows, width))
    after = np.zeros((order, width))
    for i in range(rows - 1, -1, -1):
        innovation = values[i] / deviation[i]
        for j in range(order):
            innovation += gain[i, j] * after[j]
        for j in range(order):
            after[j] = missed[i, j] * (decay[j] * after[j] - weight[j] * innovation)
        turned[i] = innovation
    return turned
