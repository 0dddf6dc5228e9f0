# SPDX-License-Identifier: Apache-2.0
"""How short a calibration may be once the lot is known.

A short campaign is k temperatures, held for so long, in p poses. Its data are cut from the
campaigns that were made: of p runs the bins of temperature next to the k targets, of these the
first part of their time, nothing else. The variance of such a slope is that from run to run. With
the lot's distribution as prior (of the other half of the devices) the slopes follow by
`population.device_effects`; their error is taken on a run that neither the short nor the full
campaign has seen, each run in turn. The ratio to the error of the full campaign is that of all
devices, with a bootstrap over them. The hours are those of the profile that `plan --fleet` would
write.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray

from imu_workbench.fleet.estimate import BIN_TIME_SHARES
from imu_workbench.fleet.short_profile import least_dwell, run_hours
from imu_workbench.fleet.statistics.population import (
    LEAST_DEVICES,
    device_effects,
    error_variances,
    fit_population,
    type_population,
)
from imu_workbench.fleet.statistics.vectors import Vectors
from imu_workbench.fleet.table import FleetTable

MOST_TEMPERATURES = 6
LARGEST_ERROR_RATIO = 1.1
"""Ratio to the error of the full campaign that a short one may reach."""
MOST_DEVICES = 500
"""Devices the curve is made of; more do not change it."""
BOOTSTRAP_DRAWS = 400
BOOTSTRAP_SEED = 11
UNMEASURED_VARIANCE = 1e12
"""Error variance of what was not measured, in variances of the lot."""


@dataclass(frozen=True)
class ShortRun:
    """What one run of a short campaign holds."""

    targets: tuple[float, ...]
    """Temperatures [°C], increasing."""
    dwells: tuple[float, ...]
    """Median time the full campaigns spent at each, times `share` [s]."""
    share: float
    hours: float
    """Duration of the run: ramps, dwells and both ends [h]."""


@dataclass(frozen=True)
class Point:
    """One short campaign of one sensor."""

    sensor: str
    temperatures: int
    share: float
    """Share of the dwells of the full campaign."""
    poses: int
    hours: float
    """Duration of all poses [h]."""
    prior: bool
    """Whether the lot's distribution is the prior."""
    ratio: float
    """Error over that of the full campaign."""
    ratio_range: tuple[float, float]
    """5 % and 95 % of the bootstrap over devices."""

    @property
    def enough(self) -> bool:
        """Whether, with the lot as prior, the error is small enough."""
        return self.prior and self.ratio <= LARGEST_ERROR_RATIO


@dataclass(frozen=True, eq=False)
class Curve:
    """Points of all sensors, and the runs they are made of."""

    points: tuple[Point, ...]
    runs: Mapping[tuple[int, float], ShortRun]
    """By number of temperatures and share."""
    full_hours: float
    """Median duration of the full campaign that they are compared with [h]."""
    devices: int


@dataclass(frozen=True, eq=False)
class _Moments:
    """Weighted sums over bins (n, runs, 3) with the levels of the runs taken out."""

    xx: FloatArray
    xy: FloatArray
    yy: FloatArray

    @classmethod
    def of(cls, x: FloatArray, y: FloatArray, weight: FloatArray) -> _Moments:
        """`x` (n, runs, bins), `y` and `weight` (n, runs, bins, 3)."""
        total = np.maximum(weight.sum(axis=2), 1e-300)[:, :, None]
        x = np.broadcast_to(x[..., None], y.shape)
        dx = x - (weight * x).sum(axis=2, keepdims=True) / total
        dy = y - (weight * y).sum(axis=2, keepdims=True) / total
        return cls(*((weight * product).sum(axis=2) for product in (dx * dx, dx * dy, dy * dy)))

    def slopes(self, runs: Sequence[int]) -> FloatArray:
        """Return (n, 3) slopes of these runs together; zero where the bins determine none."""
        xx, xy = self.xx[:, runs].sum(axis=1), self.xy[:, runs].sum(axis=1)
        slopes: FloatArray = np.divide(xy, xx, out=np.zeros_like(xy), where=xx > 0.0)
        return slopes

    def error(self, run: int, slopes: FloatArray) -> FloatArray:
        """Return (n, 3) mean squares the slopes leave in a run."""
        xx, xy, yy = self.xx[:, run], self.xy[:, run], self.yy[:, run]
        error: FloatArray = yy - 2.0 * slopes * xy + slopes**2 * xx
        return error


@dataclass(frozen=True, eq=False)
class _Bins:
    """Block means of n devices, one sensor and one share of their time; NaN fills up."""

    temperature: FloatArray
    """(n, runs, bins)"""
    seconds: FloatArray
    """(n, runs, bins)"""
    mean: FloatArray
    """(n, runs, bins, 3)"""
    variance: FloatArray
    """(n, runs, bins, 3)"""

    def of(self, chosen: NDArray[np.bool_]) -> _Bins:
        """Return the chosen devices."""
        names = ('temperature', 'seconds', 'mean', 'variance')
        return _Bins(*(getattr(self, name)[chosen] for name in names))

    def at(self, targets: Sequence[float]) -> _Bins:
        """Return the bins next to the targets; where two have the same, it counts once."""
        off = np.abs(self.temperature[..., None] - np.array(targets))
        place = np.argmin(np.where(np.isnan(off), np.inf, off), axis=2)
        again = np.zeros(place.shape, dtype=bool)
        again[..., 1:] = place[..., 1:] == place[..., :-1]
        mean = np.take_along_axis(self.mean, place[..., None], axis=2)
        return _Bins(
            np.take_along_axis(self.temperature, place, axis=2),
            np.take_along_axis(self.seconds, place, axis=2),
            np.where(again[..., None], np.nan, mean),
            np.take_along_axis(self.variance, place[..., None], axis=2),
        )

    def weighted_by_precision(self) -> _Moments:
        """Return the sums weighted by inverse variance: slopes follow from them."""
        return self._moments(1.0 / self.variance)

    def weighted_by_time(self) -> _Moments:
        """Return the sums weighted by time: the error of slopes follows from them."""
        seconds = self.seconds / np.nansum(self.seconds, axis=(1, 2), keepdims=True)
        return self._moments(np.repeat(seconds[..., None], 3, axis=3))

    def _moments(self, weight: FloatArray) -> _Moments:
        there = np.isfinite(self.mean) & np.isfinite(weight)
        return _Moments.of(
            np.nan_to_num(self.temperature),
            np.where(there, self.mean, 0.0),
            np.where(there, weight, 0.0),
        )


def shortening_curve(
    table: FleetTable, sensors: Sequence[Vectors], odd: Sequence[str]
) -> Curve | None:
    """Return the curve of all sensors over ordinary devices; None where no lot is large enough.

    Devices of a lot without a distribution are left out.
    """
    points: list[Point] = []
    runs: dict[tuple[int, float], ShortRun] = {}
    hours: list[float] = []
    count = 0
    for vectors in sensors:
        ordinary = vectors.of(~np.isin(vectors.device, list(odd)) & (vectors.runs > 1))
        ordinary = ordinary.of(np.arange(len(ordinary)) % -(-len(ordinary) // MOST_DEVICES) == 0)
        bins = _read_bins(table, ordinary)
        ordinary = ordinary.of(np.isin(ordinary.device, bins.device))
        prior = _lot_priors(ordinary)
        known = np.isfinite(prior.mean).all(axis=1)
        if not known.any():
            continue
        ordinary, prior, bins = ordinary.of(known), prior.of(known), bins.of(known)
        poses = bins.of_share[1.0].mean.shape[1]
        runs = runs or dict(_runs(bins.of_share))
        recorded = np.nansum(bins.of_share[1.0].seconds, axis=(1, 2)) / 3600.0
        hours.append(float(np.median(recorded)) * (poses - 1) / poses)
        points += _sensor_points(ordinary.sensor, prior, bins.of_share, runs)
        count = max(count, len(ordinary))
    return Curve(tuple(points), runs, max(hours), count) if points else None


@dataclass(frozen=True, eq=False)
class _FleetBins:
    """Devices whose bins are known, in order, and the bins by share."""

    device: NDArray[np.str_]
    of_share: Mapping[float, _Bins]

    def of(self, chosen: NDArray[np.bool_]) -> _FleetBins:
        of_share = {share: bins.of(chosen) for share, bins in self.of_share.items()}
        return _FleetBins(self.device[chosen], of_share)


def _read_bins(table: FleetTable, vectors: Vectors) -> _FleetBins:
    """Return the bins of devices that have as many runs as nine of ten have at least."""
    rows = table.rows(
        """SELECT device, any_value(block_run), any_value(block_share),
                  any_value(block_temperature), any_value(block_seconds),
                  list(block_mean ORDER BY axis), list(block_variance ORDER BY axis)
           FROM results WHERE role = 'fitted' AND sensor = $sensor AND block_share IS NOT NULL
             AND device IN (SELECT unnest($devices)) GROUP BY device ORDER BY device""",
        sensor=vectors.sensor,
        devices=vectors.device.tolist(),
    )
    counts = [len(set(row[1])) for row in rows]
    poses = int(np.quantile(counts, 0.1, method='lower')) if rows else 0
    rows = [row for row, count in zip(rows, counts, strict=True) if count >= poses > 1]
    device = np.array([row[0] for row in rows], dtype=np.str_)
    of_share = {share: _stacked(rows, share, poses) for share in BIN_TIME_SHARES} if rows else {}
    return _FleetBins(device, of_share)


def _stacked(rows: Sequence[tuple[Any, ...]], share: float, poses: int) -> _Bins:
    cut = []
    for _, run, shares, *values in rows:
        columns = np.vstack([np.array(value, dtype=float) for value in values])
        place, kept = np.unique(run, return_inverse=True)[1], np.array(shares) == share
        cut.append([columns[:, kept & (place == r)] for r in range(poses)])
    most = max(part.shape[1] for device in cut for part in device)
    whole = np.full((len(cut), poses, most, 8), np.nan)
    for n, device in enumerate(cut):
        for r, part in enumerate(device):
            whole[n, r, : part.shape[1]] = part.T
    return _Bins(whole[..., 0], whole[..., 1], whole[..., 2:5], whole[..., 5:8])


def _runs(of_share: Mapping[float, _Bins]) -> Iterator[tuple[tuple[int, float], ShortRun]]:
    """Yield the runs to study; a share that shortens no dwell of the profile is left out."""
    whole = of_share[1.0].temperature
    low = float(np.median(np.nanmin(whole, axis=(1, 2))))
    high = float(np.median(np.nanmax(whole, axis=(1, 2))))
    for k in range(1, MOST_TEMPERATURES + 1):
        ends = np.linspace(low, high, k) if k > 1 else [0.5 * (low + high)]
        targets = tuple(round(float(value), 1) for value in ends)
        before = np.inf
        for share in BIN_TIME_SHARES:
            seconds = np.nanmedian(of_share[share].at(targets).seconds, axis=(0, 1))
            dwells = tuple(least_dwell(value) for value in seconds)
            hours = run_hours(targets, dwells)
            if hours < before:
                yield (k, share), ShortRun(targets, dwells, share, hours)
            before = hours


def _sensor_points(
    sensor: str,
    prior: _Prior,
    of_share: Mapping[float, _Bins],
    runs: Mapping[tuple[int, float], ShortRun],
) -> list[Point]:
    whole = of_share[1.0]
    full, by_time = whole.weighted_by_precision(), whole.weighted_by_time()
    poses = whole.mean.shape[1]
    n = len(prior.mean)
    others = [[r for r in range(poses) if r != held] for held in range(poses)]
    reference = np.mean([by_time.error(r, full.slopes(o)) for r, o in enumerate(others)], axis=0)
    chosen = np.random.default_rng(BOOTSTRAP_SEED).multinomial(
        n, np.full(n, 1.0 / n), BOOTSTRAP_DRAWS
    )
    points = []
    for (k, share), run in runs.items():
        short = of_share[share].at(run.targets).weighted_by_precision()
        between = np.array([short.slopes([r]) for r in range(poses)])
        variance = between.var(axis=0, ddof=1).mean(axis=0) if k > 1 else np.full(3, np.inf)
        for p in range(1, poses):
            for known in (True, False) if k > 1 else (True,):
                squares = []
                for held, seen in enumerate(others):
                    values = short.slopes(seen[:p])
                    if known:
                        values = _with_prior(prior, values, variance / p)
                    squares.append(by_time.error(held, values))
                ratio = _ratio(np.mean(squares, axis=0), reference, chosen)
                points.append(Point(sensor, k, share, p, p * run.hours, known, *ratio))
    return points


@dataclass(frozen=True, eq=False)
class _Prior:
    """Distribution of the other half of each device's lot, or of its type; NaN where unknown."""

    mean: FloatArray
    """(n, 3)"""
    covariance: FloatArray
    """(n, 3, 3)"""

    def of(self, chosen: NDArray[np.bool_]) -> _Prior:
        return _Prior(self.mean[chosen], self.covariance[chosen])


def _lot_priors(vectors: Vectors) -> _Prior:
    n = len(vectors)
    prior = _Prior(np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan))
    error = error_variances(vectors)
    for kind in np.unique(vectors.type):
        # The type's distribution follows from lots whose halves have one of their own.
        shared = type_population(vectors.of(vectors.type == kind), 2 * LEAST_DEVICES)
        for lot in np.unique(vectors.lot[vectors.type == kind]):
            own = np.flatnonzero((vectors.type == kind) & (vectors.lot == lot))
            for taught, asked in ((own[::2], own[1::2]), (own[1::2], own[::2])):
                if len(taught) >= LEAST_DEVICES:
                    found = fit_population(vectors.coefficients[taught], error[taught])
                    prior.mean[asked], prior.covariance[asked] = found[0], found[2]
                elif shared:
                    prior.mean[asked], prior.covariance[asked] = shared.mean, shared.of_devices
    return prior


def _with_prior(prior: _Prior, values: FloatArray, variance: FloatArray) -> FloatArray:
    """Return the slopes with the prior.

    `variance` (3,) is that of their error; infinite where nothing was measured.
    """
    error = np.minimum(variance, UNMEASURED_VARIANCE * np.einsum('nii->ni', prior.covariance))
    return device_effects(values, error, prior.mean, prior.covariance)[0]


def _ratio(
    short: FloatArray, full: FloatArray, chosen: NDArray[np.int64]
) -> tuple[float, tuple[float, float]]:
    """Return the ratio of errors and its range, from (n, 3) mean squares of both.

    `chosen` (draws, n): how often each draw of the bootstrap takes a device.
    """
    scale = np.median(full, axis=0)
    one, other = (short / scale).mean(axis=1), (full / scale).mean(axis=1)
    low, high = np.quantile(np.sqrt((chosen @ one) / (chosen @ other)), [0.05, 0.95])
    return float(np.sqrt(one.mean() / other.mean())), (float(low), float(high))


def shortest(curve: Curve, sensors: Sequence[str]) -> dict[str, Any] | None:
    """Return the campaign of least hours that is enough in these sensors; None where none is."""
    campaigns: dict[tuple[int, float, int], list[Point]] = {}
    for point in curve.points:
        if point.sensor in sensors and point.enough:
            key = point.temperatures, point.share, point.poses
            campaigns.setdefault(key, []).append(point)
    fine = [own for own in campaigns.values() if len(own) == len(sensors)]
    if not fine:
        return None
    own = min(fine, key=lambda own: (own[0].hours, max(point.ratio for point in own)))
    best = own[0]
    run = curve.runs[best.temperatures, best.share]
    return {
        'temperatures': best.temperatures,
        'poses': best.poses,
        'share': best.share,
        'hours': best.hours,
        'ratio': max(point.ratio for point in own),
        'upper': max(point.ratio_range[1] for point in own),
        'targets': list(run.targets),
        'dwells_s': list(run.dwells),
    }


def curve_content(curve: Curve) -> dict[str, Any]:
    """Return the curve and its shortest campaigns as plain values."""
    sensors = list(dict.fromkeys(point.sensor for point in curve.points))
    return {
        'good_enough': LARGEST_ERROR_RATIO,
        'devices': curve.devices,
        'full_hours': curve.full_hours,
        'points': [asdict(point) for point in curve.points],
        'shortest': shortest(curve, sensors),
        'shortest_of': {sensor: shortest(curve, [sensor]) for sensor in sensors},
    }
