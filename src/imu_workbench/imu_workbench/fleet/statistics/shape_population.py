# SPDX-License-Identifier: Apache-2.0
"""What the devices of a lot share of an effect whose columns have a shape parameter.

A device carries the effect with probability π; then its three coefficients and the logarithm of
its shape parameter are drawn from one normal distribution, u = (c_x, c_y, c_z, ln θ) ~ N(m, C).
For each θ of a grid its runs give the coefficients ĉ(θ) with variances V(θ), and

    p(y | c, θ) / p(y | absent) = exp(½ ĉᵀV⁻¹ĉ − ½ (c − ĉ)ᵀV⁻¹(c − ĉ)).

Given θ all is normal, so that EM is in closed form on the grid (Dempster, Laird and Rubin 1977,
"Maximum likelihood from incomplete data via the EM algorithm", JRSS B 39): the coefficients'
posterior is that of `population`, π, m and C are the weighted moments. The covariance of m is the
inverse of the sum of squared scores of the devices (Berndt, Hall, Hall and Hausman 1974).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_UNITS, FloatArray
from thermal_comp.effects.effect import Effect

from imu_workbench.fleet.statistics.prevalence import Prevalence
from imu_workbench.fleet.table import FleetTable

GRID_POINTS = 41
"""Values of ln θ between the ends of the forms that were tried."""
MOST_FITTED_DEVICES = 150
"""Devices of a lot the distribution is fitted to."""
LEAST_DEVICES = 10
"""Four means and their covariance need more than a few devices that carry the effect."""
MOST_ITERATIONS = 100
TOLERANCE = 1e-3
"""EM ends where no mean moves by more, in standard deviations of the lot."""


@dataclass(frozen=True, eq=False)
class ShapePopulation:
    """Distribution of the coefficients and the shape parameter of one effect in a lot."""

    type: str
    lot: str
    sensor: str
    effect: str
    unit: str
    """Unit of a coefficient."""
    parameter: str
    parameter_unit: str
    devices: int
    share: float
    """Share of the devices that have the effect."""
    mean: FloatArray
    """(4,) coefficients of x, y, z, and ln of the shape parameter."""
    mean_std: FloatArray
    """(4,) standard deviations of the estimates of the means."""
    covariance: FloatArray
    """(4, 4) from device to device."""

    def content(self) -> dict[str, Any]:
        """Return plain values; the shape parameter also as median and factor of one σ."""
        std = np.sqrt(np.diag(self.covariance))
        return {
            'type': self.type,
            'lot': self.lot,
            'sensor': self.sensor,
            'effect': self.effect,
            'unit': self.unit,
            'parameter': self.parameter,
            'parameter_unit': self.parameter_unit,
            'devices': self.devices,
            'share': self.share,
            'mean': self.mean.tolist(),
            'mean_std': self.mean_std.tolist(),
            'covariance': self.covariance.tolist(),
            'std': std.tolist(),
            'median': float(np.exp(self.mean[3])),
            'median_range': [
                float(np.exp(self.mean[3] + k * self.mean_std[3])) for k in (-1.96, 1.96)
            ],
            'factor': float(np.exp(std[3])),
        }


@dataclass(frozen=True, eq=False)
class ShapeEvidence:
    """Estimates of one effect from the runs of n devices, at each value of its shape parameter."""

    log_shape: FloatArray
    """(k,) ln θ, increasing."""
    coefficients: FloatArray
    """(n, k, 3)"""
    std: FloatArray
    """(n, k, 3)"""

    def refined(self, count: int = GRID_POINTS) -> ShapeEvidence:
        """Return it on an even grid: ĉ/σ and ln σ are smooth in ln θ."""
        from scipy.interpolate import CubicSpline

        x = np.linspace(self.log_shape[0], self.log_shape[-1], count)
        ratio = CubicSpline(self.log_shape, self.coefficients / self.std, axis=1)(x)
        std = np.exp(CubicSpline(self.log_shape, np.log(self.std), axis=1)(x))
        return ShapeEvidence(x, ratio * std, std)


@dataclass(frozen=True, eq=False)
class ShapeFit:
    """Share π, mean m (4,), its covariance, and covariance C (4, 4), of `fit_shapes`."""

    share: float
    mean: FloatArray
    mean_covariance: FloatArray
    covariance: FloatArray


def fit_shapes(evidence: ShapeEvidence, share: float = 0.5) -> ShapeFit:
    """Return the distribution of coefficients and ln θ over the devices; `share` is a start."""
    fine = evidence.refined()
    scale = np.median(np.abs(fine.coefficients), axis=(0, 1)) + np.median(fine.std, axis=(0, 1))
    c, v, x = fine.coefficients / scale, (fine.std / scale) ** 2, fine.log_shape
    half_chi2 = 0.5 * (c**2 / v).sum(axis=2)
    least = (x[1] - x[0]) ** 2  # no scatter of ln θ below the step of the grid
    start = int(np.argmax(np.logaddexp(0.0, half_chi2 - 3.0).sum(axis=0)))
    mean = np.append(c[:, start].mean(axis=0), x[start])
    spread = np.maximum(c[:, start].var(axis=0) - np.median(v[:, start], axis=0), 0.1)
    covariance = np.diag(np.append(spread, 0.25))
    for _ in range(MOST_ITERATIONS):
        moved, covariance, share, score = _step(c, v, x, half_chi2, mean, covariance, share, least)
        change = np.abs(moved - mean) / np.sqrt(np.diag(covariance))
        mean = moved
        if change.max() < TOLERANCE:
            break
    factors = np.append(scale, 1.0)
    outer = np.outer(factors, factors)
    of_mean = np.linalg.pinv(score.T @ score)
    return ShapeFit(share, mean * factors, of_mean * outer, covariance * outer)


def _step(
    c: FloatArray,
    v: FloatArray,
    x: FloatArray,
    half_chi2: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
    share: float,
    least: float,
) -> tuple[FloatArray, FloatArray, float, FloatArray]:
    """Return mean, covariance and share after one step of EM, and (n, 4) scores of the mean."""
    slope = covariance[:3, 3] / covariance[3, 3]
    given = covariance[:3, :3] - np.outer(slope, covariance[3, :3])
    expected = mean[:3] + np.outer(x - mean[3], slope)
    total = given + v[..., None] * np.eye(3)
    weight = np.linalg.inv(total)
    off = c - expected
    # ln of the coefficients' marginal likelihood over that of none, on the grid of ln θ.
    log_bayes = half_chi2 + 0.5 * (
        np.log(v).sum(axis=2)
        - np.linalg.slogdet(total)[1]
        - np.einsum('nki,nkij,nkj->nk', off, weight, off)
    )
    log_prior = -0.5 * (x - mean[3]) ** 2 / covariance[3, 3]
    log_prior -= np.logaddexp.reduce(log_prior)
    log_has = np.log(share) + log_prior + log_bayes
    every = np.concatenate([log_has, np.full((len(c), 1), np.log1p(-min(share, 1 - 1e-9)))], 1)
    has = np.exp(log_has - np.logaddexp.reduce(every, axis=1)[:, None])
    # Moments of the posterior of (c, ln θ), weighted by how probable the device has it there.
    shrink = given @ weight
    own = expected + np.einsum('nkij,nkj->nki', shrink, off)
    u = np.concatenate([own, np.broadcast_to(x[:, None], (*own.shape[:2], 1))], axis=2)
    count = float(has.sum())
    moved: FloatArray = np.einsum('nk,nki->i', has, u) / count
    deviation = u - moved
    grown = np.einsum('nk,nki,nkj->ij', has, deviation, deviation) / count
    grown[:3, :3] += np.einsum('nk,nkij->ij', has, given - shrink @ given) / count
    grown[3, 3] = max(grown[3, 3], least)
    grown = 0.5 * (grown + grown.T) + 1e-9 * np.eye(4)
    score = np.einsum('nk,nki->ni', has, deviation) @ np.linalg.inv(grown)
    return moved, grown, float(np.clip(count / len(c), 1e-3, 1.0)), score


def shape_populations(
    table: FleetTable,
    named: Iterable[Prevalence],
    catalogue: Mapping[str, type[Effect]],
    odd: Collection[tuple[str, str]] = (),
) -> list[ShapePopulation]:
    """Return the distribution of each effect that is named in a lot and has a shape parameter.

    `odd` (device, sensor) are left out, as in its prevalence; so is an effect that is not in the
    catalogue, such as one of a file that an earlier run was given and this one is not.
    """
    found = []
    for one in (one for one in named if one.effect in catalogue):
        evidence = _evidence(table, one, odd)
        if evidence is None or one.share * len(evidence.coefficients) < LEAST_DEVICES:
            continue
        fit = fit_shapes(evidence, one.share)
        effect = catalogue[one.effect]
        (parameter,) = fields(effect())
        found.append(
            ShapePopulation(
                type=one.type,
                lot=one.lot,
                sensor=one.sensor,
                effect=one.effect,
                unit=effect.coefficient_units[0].format(unit=SENSOR_UNITS[one.sensor]),
                parameter=parameter.name,
                parameter_unit=parameter.metadata['unit'],
                devices=one.devices,
                share=fit.share,
                mean=fit.mean,
                mean_std=np.sqrt(np.diag(fit.mean_covariance)),
                covariance=fit.covariance,
            )
        )
    return found


def _evidence(
    table: FleetTable, one: Prevalence, odd: Collection[tuple[str, str]]
) -> ShapeEvidence | None:
    """Return the estimates from the ordinary devices of a lot, where several forms were kept."""
    rows = table.rows(
        """SELECT any_value(shapes), list(coefficients ORDER BY axis), list(std ORDER BY axis),
                  any_value(device)
           FROM results WHERE role = 'candidate' AND shapes IS NOT NULL AND type = $kind
             AND lot = $lot AND sensor = $sensor AND effect = $effect
           GROUP BY source HAVING count(*) = 3 ORDER BY source""",
        kind=one.type,
        lot=one.lot,
        sensor=one.sensor,
        effect=one.effect,
    )
    rows = [row for row in rows if (row[3], one.sensor) not in odd]
    if not rows:
        return None
    rows = rows[:: -(-len(rows) // MOST_FITTED_DEVICES)]
    shapes = np.array(rows[0][0], dtype=float)
    coefficients = np.array([row[1] for row in rows], dtype=float).transpose(0, 2, 1)
    std = np.array([row[2] for row in rows], dtype=float).transpose(0, 2, 1)
    shown = np.isfinite(std).all(axis=(0, 2))
    if shown.sum() < 4 or not (shapes > 0.0).all():
        return None
    return ShapeEvidence(np.log(shapes[shown]), coefficients[:, shown], std[:, shown])
