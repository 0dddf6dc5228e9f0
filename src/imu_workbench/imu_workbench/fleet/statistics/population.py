# SPDX-License-Identifier: Apache-2.0
"""What the devices of a lot share: mean and covariance of their coefficients.

Empirical Bayes for y_i = μ + b_i + e_i with b_i ~ N(0, Σ) and e_i ~ N(0, V_i), V_i known: the
variance of a device's fit, plus the scatter of its runs beyond that. EM in closed form
(Laird and Ware 1982, "Random-effects models for longitudinal data", Biometrics 38): the posterior
of b_i has covariance P_i = (Σ⁻¹ + V_i⁻¹)⁻¹ and mean P_i V_i⁻¹ (y_i − μ); μ and Σ follow from them,
Σ by restricted likelihood: with the uncertainty of μ, the scatter of few devices is not too small.

The means of the lots of a type are drawn in the same way from the type's: a lot's own mean is
shrunk to it, which hardly moves that of many devices and makes one of few useful.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray

from imu_workbench.fleet.statistics.vectors import Vectors

MOST_ITERATIONS = 500
TOLERANCE = 1e-6
"""EM ends where the mean moves by less, in standard deviations, and Σ by less of itself."""
LEAST_DEVICES = 5
"""Devices a lot needs for a covariance of three axes."""
LEAST_LOTS = 3
"""Lots of so many devices that the distribution of a type needs."""
TYPE_WEIGHT = 5.0
"""Weight of the type's covariance in that of a lot, as a number of devices; and of its form in
the covariance between few lots, as a number of lots: this one is never singular."""


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


@dataclass(frozen=True, eq=False)
class TypePopulation:
    """Distribution of the lots' means of one sensor in one type."""

    type: str
    sensor: str
    unit: str
    lots: int
    mean: FloatArray
    """(d,)"""
    mean_covariance: FloatArray
    """(d, d) of the estimate of the mean."""
    covariance: FloatArray
    """(d, d) from lot to lot."""
    within: FloatArray
    """(d, d) from device to device of a lot, the mean of the lots."""

    @property
    def of_lots(self) -> FloatArray:
        """(d, d) of the mean of a lot that is not known, about `mean`."""
        covariance: FloatArray = self.mean_covariance + self.covariance
        return covariance

    @property
    def of_devices(self) -> FloatArray:
        """(d, d) of the devices of a lot that is not known, about `mean`."""
        covariance: FloatArray = self.of_lots + self.within
        return covariance


def error_variances(vectors: Vectors) -> FloatArray:
    """Return (n, 3) the variance of each device's estimate: fit, and scatter of its runs.

    The scatter from run to run is pooled over the devices, and counts only beyond the variances of
    the fits to single runs.
    """
    variance: FloatArray = vectors.std**2 + run_variance(vectors) / vectors.runs[:, None]
    return variance


def run_variance(vectors: Vectors) -> FloatArray:
    """Return (3,) the variance between runs of a device beyond that of fits to single runs."""
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

    `values` (n, d) with error variances (n, d), independent of each other, or covariances
    (n, d, d); n > 1.
    """
    noise = _matrices(variances)
    scale = np.sqrt(values.var(axis=0) + np.einsum('nii->i', noise) / len(values))
    y, noise = values / scale, noise / np.outer(scale, scale)
    mean, sigma = y.mean(axis=0), np.cov(y.T) + 1e-9 * np.eye(y.shape[1])
    of_mean = np.zeros_like(sigma)
    for _ in range(MOST_ITERATIONS):
        weight = np.linalg.inv(sigma + noise)
        of_mean = np.linalg.inv(weight.sum(axis=0))
        moved = of_mean @ np.einsum('nij,nj->i', weight, y)
        gain = sigma @ weight
        effects = np.einsum('nij,nj->ni', gain, y - moved)
        posterior = sigma - gain @ sigma + gain @ of_mean @ gain.transpose(0, 2, 1)
        grown = effects.T @ effects / len(y) + posterior.mean(axis=0)
        change = max(np.abs(moved - mean).max(), np.abs(grown - sigma).max())
        mean, sigma = moved, 0.5 * (grown + grown.T)
        if change < TOLERANCE:
            break
    outer = np.outer(scale, scale)
    return mean * scale, of_mean * outer, sigma * outer


def _matrices(variances: FloatArray) -> FloatArray:
    """Return covariances (n, d, d) of variances (n, d), or what are covariances already."""
    if variances.ndim == 3:
        return variances
    return np.asarray(variances[:, :, None] * np.eye(variances.shape[1]))


def device_effects(
    values: FloatArray, variances: FloatArray, mean: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return (n, d) posterior means of the coefficients and (n, d, d) their covariances.

    `mean` (d,) or (n, d) and `covariance` (d, d) or (n, d, d) are what they are drawn from.
    """
    gain = covariance @ np.linalg.inv(covariance + _matrices(variances))
    shrunk: FloatArray = mean + np.einsum('nij,nj->ni', gain, values - mean)
    return shrunk, covariance - gain @ covariance


def populations(
    vectors: Vectors, ordinary: Sequence[bool] | None = None
) -> tuple[list[Population], list[TypePopulation]]:
    """Return the distribution in every lot and of the lots; only `ordinary` devices count.

    Lots are shrunk to their type where it is known; one with few devices has none elsewhere.
    """
    if ordinary is not None:
        vectors = vectors.of(np.asarray(ordinary, dtype=bool))
    found, types = [], []
    for kind in dict.fromkeys(vectors.type.tolist()):
        own = vectors.of(vectors.type == kind)
        shared = type_population(own)
        types += [shared] if shared else []
        for _, group in own.groups():
            if shared or len(group) >= LEAST_DEVICES:
                found.append(_lot_population(group, shared))
    return found, types


def type_population(vectors: Vectors, least: int = LEAST_DEVICES) -> TypePopulation | None:
    """Return the distribution of the lots of one type with `least` devices; None of too few."""
    lots = [_lot_population(group, None) for _, group in vectors.groups() if len(group) >= least]
    if len(lots) < LEAST_LOTS:
        return None
    means, errors = (
        np.array([getattr(lot, n) for lot in lots]) for n in ('mean', 'mean_covariance')
    )
    mean, of_mean, covariance = fit_population(means, errors)
    devices = [lot.devices for lot in lots]
    within = np.average([lot.covariance for lot in lots], axis=0, weights=devices)
    share = float(np.mean(np.diag(covariance) / np.diag(within)))
    covariance = _mixed(covariance, len(lots), share * within)
    one = lots[0]
    return TypePopulation(
        type=one.type,
        sensor=one.sensor,
        unit=one.unit,
        lots=len(lots),
        mean=mean,
        mean_covariance=of_mean,
        covariance=covariance,
        within=within,
    )


def _lot_population(group: Vectors, shared: TypePopulation | None) -> Population:
    variances = error_variances(group)
    run_std = np.full(3, np.nan)
    if (group.runs > 1).any():
        run_std = np.sqrt(np.nanmean(group.run_std**2, axis=0))
    names = str(group.type[0]), str(group.lot[0]), group.sensor, group.unit, len(group)
    if len(group) >= LEAST_DEVICES:
        lot = Population(*names, *fit_population(group.coefficients, variances), run_std)
    else:
        assert shared is not None  # noqa: S101 (few devices alone have no population)
        weight = np.linalg.inv(shared.within + _matrices(variances))
        of_mean = np.linalg.inv(weight.sum(axis=0))
        mean = of_mean @ np.einsum('nij,nj->i', weight, group.coefficients)
        lot = Population(*names, mean, of_mean, shared.within, run_std)
    return _shrunk(lot, shared) if shared else lot


def _shrunk(lot: Population, shared: TypePopulation) -> Population:
    mean, of_mean = device_effects(
        lot.mean[None], lot.mean_covariance[None], shared.mean, shared.of_lots
    )
    covariance = _mixed(lot.covariance, lot.devices, shared.within)
    return replace(lot, mean=mean[0], mean_covariance=of_mean[0], covariance=covariance)


def _mixed(covariance: FloatArray, count: int, expected: FloatArray) -> FloatArray:
    """Return the mean of a covariance of so many and the expected one that counts TYPE_WEIGHT."""
    mixed: FloatArray = (count * covariance + TYPE_WEIGHT * expected) / (count + TYPE_WEIGHT)
    return mixed
