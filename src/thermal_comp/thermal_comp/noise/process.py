# SPDX-License-Identifier: Apache-2.0
"""White noise and Ornstein-Uhlenbeck processes: autocovariance, draws, periodogram."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from scipy.fft import irfft, next_fast_len, rfft

from thermal_comp.model.values import NoiseModel

OU_TIME_CONSTANTS = np.geomspace(30.0, 40_000.0, 7)
"""Correlation times [s] of the processes whose sum approximates flicker noise."""
CORRELATED_SHARE = 0.9
"""Share of the longest run over which the slowest is correlated, at least: over days the biases of
MEMS walk at random (IEEE 952), which a process that forgets in half a day does not."""


def correlation_times(longest: float, scale: float = 1.0) -> FloatArray:
    """Return (7,) correlation times [s] of the processes that are fitted to runs up to so long.

    `scale`: share of the usual times that those of the recordings are (`time_scale`).
    """
    shortest, usual = scale * OU_TIME_CONSTANTS[[0, -1]]
    slowest = max(usual, CORRELATED_SHARE * longest)
    return np.geomspace(shortest, slowest, len(OU_TIME_CONSTANTS))


def process_autocovariance(time_constants: FloatArray, period: float, lags: int) -> FloatArray:
    """Return (k, lags) autocovariance of means over `period` of processes of unit variance.

    γ(0) = 2 (r − 1 + e^{−r}) / r²,  γ(m) = ((1 − e^{−r}) / r)² e^{−r (m − 1)},  r = period / τ.
    """
    r = (period / time_constants)[:, None]
    m = np.arange(lags)[None, :]
    covariance: FloatArray = (np.expm1(-r) / r) ** 2 * np.exp(-r * (m - 1))
    covariance[:, 0] = (2.0 * (r + np.expm1(-r)) / r**2)[:, 0]
    return covariance


def mean_autocovariance(noise: NoiseModel, axis: int, period: float, lags: int) -> FloatArray:
    """Return (lags,) autocovariance of means over `period` seconds of one axis [unit²]."""
    each = process_autocovariance(noise.time_constants, period, lags)
    covariance: FloatArray = noise.amplitudes[:, axis] ** 2 @ each
    covariance[0] += noise.white[axis] ** 2 / period
    return covariance


def toeplitz_product(covariance: FloatArray, slot: IntArray, values: FloatArray) -> FloatArray:
    """Return S @ values, (m, q), where S[i, j] = covariance[|slot_i − slot_j|]."""
    return next(toeplitz_products([covariance], slot, values))


def toeplitz_products(
    covariances: Iterable[FloatArray], slot: IntArray, values: FloatArray
) -> Iterator[FloatArray]:
    """Yield `toeplitz_product` of each covariance; the values are transformed once."""
    length = int(slot[-1]) + 1
    size = next_fast_len(2 * length - 1, real=True)
    padded = np.zeros((values.shape[1], size))
    padded[:, slot] = values.T
    transformed = rfft(padded, overwrite_x=True)
    for covariance in covariances:
        kernel = np.zeros(size)
        kernel[:length] = covariance[:length]
        kernel[size - length + 1 :] = covariance[1:length][::-1]
        spectrum = rfft(kernel).real
        yield np.ascontiguousarray(irfft(spectrum * transformed, size)[:, slot].T)


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


@dataclass(frozen=True, eq=False)
class ResidualSpectrum:
    """Spectrum of one run after a projection, on the Fourier frequencies of its grid."""

    periodogram: FloatArray
    """(f, axes) |DFT of the residual|² / m."""
    expected: FloatArray
    """(k + 1, f) its expectation for white noise of unit density and each unit process."""
    weight: FloatArray
    """(f,) degrees of freedom: share of white power left, times share of slots present."""
    shaken: FloatArray
    """(f,) its expectation for the noise of vibration, of unit density per unit of vibration."""
    time_constants: FloatArray
    """(k,) correlation times of the processes [s]."""

    def with_white(self, factor: float) -> ResidualSpectrum:
        """Return the spectrum of a run whose white noise is larger by a factor than the unit."""
        expected = np.vstack([factor**2 * self.expected[:1], self.expected[1:]])
        return replace(self, expected=expected)


@dataclass(frozen=True, eq=False)
class Shaking:
    """Weights and added variance of rows that were taken while the device was shaken."""

    weights: FloatArray
    """(m,) standard deviation of still rows over that of each row, at most 1."""
    variance: FloatArray
    """(m,) variance that a unit density per unit of vibration adds to each row."""


@dataclass(frozen=True, eq=False)
class Projection:
    """A projection of some rows, and the spectra of noise processes after it."""

    slot: IntArray
    basis: FloatArray
    expected: FloatArray
    weight: FloatArray
    shaken: FloatArray
    time_constants: FloatArray
    shaking: Shaking | None = None

    def spectrum_of(self, values: FloatArray) -> ResidualSpectrum:
        """Return the spectrum of values (m, axes) after the projection."""
        weighted = values if self.shaking is None else self.shaking.weights[:, None] * values
        left = weighted - self.basis @ (self.basis.T @ weighted)
        periodogram = np.abs(_spectrum(left, self.slot)) ** 2 / len(self.slot)
        return ResidualSpectrum(
            periodogram=periodogram,
            expected=self.expected,
            weight=self.weight,
            shaken=self.shaken,
            time_constants=self.time_constants,
        )


def project_spectra(
    slot: IntArray,
    basis: FloatArray,
    time_constants: FloatArray,
    period: float,
    shaking: Shaking | None = None,
) -> Projection:
    """Return the projection that takes `basis` (m, p; orthonormal) out, for each noise process.

    The expectation is exact: E|F M W y|² = diag(F M W S W M F*), M = D − Q Qᵀ, D the rows present,
    W their weights, so that neither leakage nor the power the model absorbs biases the noise.
    There are as many frequencies as slots; the weights count the rows that are present.
    """
    length, rows = int(slot[-1]) + 1, len(slot)
    weights = np.ones(rows) if shaking is None else shaking.weights
    present = np.zeros(length)
    present[slot] = weights
    overlap = _autocorrelation(present)
    coloured = process_autocovariance(time_constants, period, length)
    white = np.zeros(length)
    white[0] = 1.0 / period

    basis_spectrum = _spectrum(basis, slot)
    left = partial(_power_left, basis, basis_spectrum, slot)
    covariances = (white, *coloured)
    products = toeplitz_products(covariances, slot, weights[:, None] * basis)
    expected = np.stack(
        [
            left(_even_spectrum(covariance * overlap), weights[:, None] * turned)
            for covariance, turned in zip(covariances, products, strict=True)
        ]
    )
    share, shaken = expected[0] * period, np.zeros(expected.shape[1])
    if shaking is not None:
        share = left(float(rows), basis)
        added = weights**2 * shaking.variance
        shaken = left(float(added.sum()), added[:, None] * basis)
    weight = rows / length * np.clip(share, 0.0, 1.0)
    weight[0] *= 0.5
    return Projection(
        slot=slot,
        basis=basis,
        expected=expected,
        weight=weight,
        shaken=shaken,
        time_constants=time_constants,
        shaking=shaking,
    )


def _power_left(
    basis: FloatArray,
    basis_spectrum: np.ndarray,
    slot: IntArray,
    plain: FloatArray | float,
    turned: FloatArray,
) -> FloatArray:
    """Return the (f,) expected power |F (1 − Q Qᵀ) y|² / m of noise.

    `plain` (f,) is its power before the projection of `basis` Q, `turned` (m, p) its covariance
    times Q.
    """
    cross = np.einsum('fj,fj->f', basis_spectrum, _spectrum(turned, slot).conj()).real
    inner = np.einsum('fi,fi->f', basis_spectrum @ (basis.T @ turned), basis_spectrum.conj()).real
    power: FloatArray = np.maximum(plain - 2.0 * cross + inner, 0.0) / len(slot)
    return power


def _spectrum(columns: FloatArray, slot: IntArray) -> np.ndarray:
    """Return the (f, q) Fourier transform of columns (m, q) on the grid of their slots."""
    grid = np.zeros((columns.shape[1], int(slot[-1]) + 1))
    grid[:, slot] = columns.T
    return np.asarray(rfft(grid, overwrite_x=True).T)


def _autocorrelation(present: FloatArray) -> FloatArray:
    size = 2 * len(present)
    power = np.abs(np.fft.rfft(present, size)) ** 2
    correlation: FloatArray = np.fft.irfft(power, size)[: len(present)]
    return correlation


def _even_spectrum(covariance: FloatArray) -> FloatArray:
    """Return Σ_{|l| < n} c(|l|) e^{−iωl} at the n Fourier frequencies, one side."""
    wrapped = covariance.copy()
    wrapped[1:] += covariance[1:][::-1]
    spectrum: FloatArray = np.fft.rfft(wrapped).real
    return spectrum
