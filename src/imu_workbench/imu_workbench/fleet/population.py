# SPDX-License-Identifier: Apache-2.0
"""What the devices of a lot share: mean and covariance of their coefficients.

Empirical Bayes for y_i = μ + b_i + e_i with b_i ~ N(0, Σ) and e_i ~ N(0, V_i), V_i known: what the
fit of a device says of its error, plus the scatter of its runs beyond that. EM in closed form
(Laird and Ware 1982, "Random-effects models for longitudinal data", Biometrics 38): the posterior
of b_i has covariance P_i = (Σ⁻¹ + V_i⁻¹)⁻¹ and mean P_i V_i⁻¹ (y_i − μ); μ and Σ follow from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray

from imu_workbench.fleet.vectors import Vectors

ITERATIONS = 500
TOLERANCE = 1e-6
"""EM ends where the mean moves by less, in standard deviations, and Σ by less of itself."""
LEAST_DEVICES = 5
"""Devices a lot needs for a covariance of three axes."""


@dataclass(frozen=True, eq=False)
class Population:
    """Distribution of the coefficients of one sensor in one lot."""

    type: str
    lot: str
    sensor: str
    unit: str
    devices: int
    mean: FloatArray
    """(d,)"""
    mean_covariance: FloatArray
    """(d, d) of the estimate of the mean."""
    covariance: FloatArray
    """(d, d) from device to device, without the error of the estimates."""
    run_std: FloatArray
    """(d,) from run to run of one device."""


def error_variances(vectors: Vectors) -> FloatArray:
    """Return (n, 3) the variance of each device's estimate: fit, and scatter of its runs.

    The scatter from run to run is pooled over the devices, and counts only beyond what the fits
    say of single runs.
    """
    variance: FloatArray = vectors.std**2 + run_variance(vectors) / vectors.runs[:, None]
    return variance


def run_variance(vectors: Vectors) -> FloatArray:
    """Return (3,) the variance between runs of a device beyond what fits say of single runs."""
    several = vectors.runs > 1
    if not several.any():
        return np.zeros(3)
    alone = vectors.runs[several, None] * vectors.std[several] ** 2
    beyond: FloatArray = np.median(vectors.run_std[several] ** 2 - alone, axis=0)
    return np.maximum(0.0, beyond)


def fit_population(
    values: FloatArray, variances: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean (d,), its covariance and the covariance (d, d) between devices.

    `values` (n, d) with error variances (n, d), which are independent of each other; n > d.
    """
    scale = np.sqrt(values.var(axis=0) + variances.mean(axis=0))
    y, v = values / scale, variances / scale**2
    mean, sigma = y.mean(axis=0), np.cov(y.T) + 1e-9 * np.eye(y.shape[1])
    noise = v[:, :, None] * np.eye(y.shape[1])
    information = np.zeros_like(sigma)
    for _ in range(ITERATIONS):
        weight = np.linalg.inv(sigma + noise)
        information = weight.sum(axis=0)
        moved = np.linalg.solve(information, np.einsum('nij,nj->i', weight, y))
        gain = sigma @ weight
        effects = np.einsum('nij,nj->ni', gain, y - moved)
        posterior = sigma - gain @ sigma
        grown = effects.T @ effects / len(y) + posterior.mean(axis=0)
        change = max(np.abs(moved - mean).max(), np.abs(grown - sigma).max())
        mean, sigma = moved, 0.5 * (grown + grown.T)
        if change < TOLERANCE:
            break
    outer = np.outer(scale, scale)
    return mean * scale, np.linalg.inv(information) * outer, sigma * outer


def device_effects(
    values: FloatArray, variances: FloatArray, mean: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return (n, d) posterior means of the coefficients and (n, d, d) their covariances."""
    noise = variances[:, :, None] * np.eye(values.shape[1])
    gain = covariance @ np.linalg.inv(covariance + noise)
    shrunk: FloatArray = mean + np.einsum('nij,nj->ni', gain, values - mean)
    return shrunk, covariance - gain @ covariance


def populations(vectors: Vectors, ordinary: Sequence[bool] | None = None) -> list[Population]:
    """Return the distribution in every lot with enough devices; only `ordinary` ones count."""
    if ordinary is not None:
        vectors = vectors.of(np.asarray(ordinary, dtype=bool))
    found = []
    for (kind, lot), group in vectors.groups():
        if len(group) < LEAST_DEVICES:
            continue
        variances = error_variances(group)
        mean, of_mean, covariance = fit_population(group.coefficients, variances)
        run_std = (
            np.sqrt(np.nanmean(group.run_std**2, axis=0))
            if (group.runs > 1).any()
            else (np.full(3, np.nan))
        )
        found.append(
            Population(
                kind, lot, group.sensor, group.unit, len(group), mean, of_mean, covariance, run_std
            )
        )
    return found
