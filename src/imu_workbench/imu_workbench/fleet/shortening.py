# SPDX-License-Identifier: Apache-2.0
"""How short a calibration may be once the lot is known.

A short campaign is k temperatures in p poses. Its data are cut from the campaigns that were made:
of p runs the bins of temperature next to the k targets, nothing else. How well they tell a slope
is seen from run to run. With the lot's distribution as prior (of the other half of the devices)
the slopes follow by `population.device_effects`; their error is taken on a run that neither the
short nor the full campaign has seen, each run in turn. The ratio to the error of the full campaign
is that of all devices, with a bootstrap over them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray

from imu_workbench.fleet.population import (
    LEAST_DEVICES,
    device_effects,
    error_variances,
    fit_population,
)
from imu_workbench.fleet.table import FleetTable
from imu_workbench.fleet.vectors import Vectors

MOST_TEMPERATURES = 6
GOOD_ENOUGH = 1.1
"""Ratio to the error of the full campaign that a short one may reach."""
STUDIED = 500
"""Devices the curve is made of; more do not change it."""
BOOTSTRAPS = 400
SEED = 11
NOT_MEASURED = 1e12
"""Error variance of what was not measured, in variances of the lot."""


@dataclass(frozen=True, eq=False)
class Point:
    """One short campaign of one sensor."""

    sensor: str
    temperatures: int
    poses: int
    prior: bool
    """Whether the lot is known."""
    ratio: float
    """Error over that of the full campaign."""
    ratio_range: tuple[float, float]
    """5 % and 95 % of the bootstrap over devices."""


@dataclass(frozen=True, eq=False)
class Curve:
    """Points of all sensors, and what the temperatures of a short campaign are."""

    points: tuple[Point, ...]
    targets: dict[int, list[float]]
    """Number of temperatures → temperatures [°C]."""
    dwell_s: float
    """How long the campaigns stood at such a temperature, in the median [s]."""
    devices: int


@dataclass(frozen=True, eq=False)
class _Moments:
    """Sums over bins of one device, per run and axis (runs, 3), levels of the runs taken out."""

    xx: FloatArray
    xy: FloatArray
    yy: FloatArray

    @classmethod
    def of(cls, run: FloatArray, x: FloatArray, y: FloatArray, weight: FloatArray) -> _Moments:
        runs = int(run.max()) + 1
        sums = np.zeros((3, runs, 3))
        for r in range(runs):
            w = weight[run == r]
            total = np.maximum(w.sum(axis=0), 1e-300)
            dx = x[run == r, None] - (w * x[run == r, None]).sum(axis=0) / total
            dy = y[run == r] - (w * y[run == r]).sum(axis=0) / total
            sums[:, r] = [(w * dx * dx).sum(0), (w * dx * dy).sum(0), (w * dy * dy).sum(0)]
        return cls(*sums)


@dataclass(frozen=True, eq=False)
class _Bins:
    """Block means of one device and sensor."""

    run: FloatArray
    temperature: FloatArray
    mean: FloatArray
    variance: FloatArray
    seconds: FloatArray

    def moments(self, targets: Sequence[float] | None = None) -> _Moments:
        """Return the sums over all bins, or over those next to the targets in each run."""
        chosen = np.ones(len(self.run), dtype=bool)
        if targets is not None:
            chosen[:] = False
            for r in np.unique(self.run):
                own = np.flatnonzero(self.run == r)
                for target in targets:
                    chosen[own[np.argmin(np.abs(self.temperature[own] - target))]] = True
        # Bins that are left out weigh nothing; the numbers of the runs stay.
        weight = np.where(chosen[:, None], 1.0 / self.variance, 0.0)
        return _Moments.of(self.run, self.temperature, self.mean, weight)

    def judged(self) -> _Moments:
        """Return the sums weighted by time, of which an error is made."""
        weight = np.repeat((self.seconds / self.seconds.sum())[:, None], 3, axis=1)
        return _Moments.of(self.run, self.temperature, self.mean, weight)


def shortening_curve(
    table: FleetTable, sensors: Sequence[Vectors], odd: Sequence[str]
) -> Curve | None:
    """Return the curve of all sensors over ordinary devices; None where no lot is large enough."""
    points: list[Point] = []
    targets: dict[int, list[float]] = {}
    dwells: list[float] = []
    count = 0
    for vectors in sensors:
        ordinary = vectors.of(~np.isin(vectors.device, list(odd)) & (vectors.runs > 1))
        if not len(ordinary):
            continue
        ordinary = ordinary.of(np.arange(len(ordinary)) % -(-len(ordinary) // STUDIED) == 0)
        bins = _read_bins(table, ordinary)
        reach = np.array([[b.temperature.min(), b.temperature.max()] for b in bins])
        low, high = (float(value) for value in np.median(reach, axis=0))
        targets = {k: _targets(low, high, k) for k in range(1, MOST_TEMPERATURES + 1)}
        dwells += [float(np.median(b.seconds)) for b in bins]
        own = _sensor_points(ordinary, bins, targets)
        count = max(count, len(ordinary)) if own else count
        points += own
    if not points:
        return None
    return Curve(tuple(points), targets, float(np.median(dwells)), count)


def _targets(low: float, high: float, count: int) -> list[float]:
    if count == 1:
        return [round(0.5 * (low + high), 1)]
    return [round(float(value), 1) for value in np.linspace(low, high, count)]


def _read_bins(table: FleetTable, vectors: Vectors) -> list[_Bins]:
    rows = table.rows(
        """SELECT device, any_value(block_run), any_value(block_temperature),
                  list(block_mean ORDER BY axis), list(block_variance ORDER BY axis),
                  any_value(block_seconds)
           FROM results WHERE role = 'fitted' AND sensor = $sensor
             AND device IN (SELECT unnest($devices)) GROUP BY device ORDER BY device""",
        sensor=vectors.sensor,
        devices=vectors.device.tolist(),
    )
    return [
        _Bins(
            np.array(run, dtype=float),
            np.array(temperature),
            np.array(mean).T,
            np.array(variance).T,
            np.array(seconds),
        )
        for _, run, temperature, mean, variance, seconds in rows
    ]


def _sensor_points(
    vectors: Vectors, bins: Sequence[_Bins], targets: dict[int, list[float]]
) -> list[Point]:
    poses = int(vectors.runs.min())
    if poses < 2:
        return []
    full, judged = [b.moments() for b in bins], [b.judged() for b in bins]
    folds = _folds(vectors)
    points = []
    for k, temperatures in targets.items():
        short = [b.moments(temperatures) for b in bins]
        between = np.array([_slopes(short, [run]) for run in range(poses)])
        variance = between.var(axis=0, ddof=1).mean(axis=0) if k > 1 else np.full(3, np.inf)
        for p in range(1, poses):
            for prior in (True, False):
                if not prior and k == 1:
                    continue
                ratio = []
                for held in range(poses):
                    others = [r for r in range(poses) if r != held]
                    reference = _slopes(full, others)
                    values = _slopes(short, others[:p])
                    if prior:
                        values = _with_prior(vectors, folds, values, variance / p)
                    ratio.append([_error(judged, held, s) for s in (values, reference)])
                points.append(_point(vectors.sensor, k, p, prior, np.mean(ratio, axis=0)))
    return points


def _slopes(moments: Sequence[_Moments], runs: Sequence[int]) -> FloatArray:
    """Return (n, 3) slopes of these runs together; zero where the bins tell none."""
    xx = np.array([m.xx[runs].sum(axis=0) for m in moments])
    xy = np.array([m.xy[runs].sum(axis=0) for m in moments])
    slopes: FloatArray = np.divide(xy, xx, out=np.zeros_like(xy), where=xx > 0.0)
    return slopes


def _error(judged: Sequence[_Moments], run: int, slopes: FloatArray) -> FloatArray:
    """Return (n, 3) mean squares the slopes leave in a run."""
    xx, xy, yy = (np.array([getattr(m, name)[run] for m in judged]) for name in ('xx', 'xy', 'yy'))
    error: FloatArray = yy - 2.0 * slopes * xy + slopes**2 * xx
    return error


def _folds(vectors: Vectors) -> NDArray[np.bool_]:
    """Return (2, n) which half of its lot each device is in."""
    place = np.zeros(len(vectors), dtype=np.int64)
    for lot in np.unique(vectors.lot):
        own = vectors.lot == lot
        place[own] = np.arange(own.sum())
    return np.array([place % 2 == 0, place % 2 == 1])


def _with_prior(
    vectors: Vectors, folds: NDArray[np.bool_], values: FloatArray, variance: FloatArray
) -> FloatArray:
    """Return the slopes with the other half of the lot as prior; as they are in small lots.

    `variance` (3,) is that of their error; infinite where nothing was measured.
    """
    found = values.copy()
    known = error_variances(vectors)
    for (kind, lot), _ in vectors.groups():
        own = (vectors.type == kind) & (vectors.lot == lot)
        for fold in folds:
            taught, asked = own & ~fold, own & fold
            if taught.sum() < LEAST_DEVICES:
                continue
            mean, _, covariance = fit_population(vectors.coefficients[taught], known[taught])
            limit = NOT_MEASURED * np.diag(covariance)
            same = np.tile(np.minimum(variance, limit), (int(asked.sum()), 1))
            found[asked] = device_effects(values[asked], same, mean, covariance)[0]
    return found


def _point(sensor: str, temperatures: int, poses: int, prior: bool, squares: FloatArray) -> Point:
    """`squares` (2, n, 3): mean square errors of the short and of the full campaign."""
    scale = np.median(squares[1], axis=0)
    short, full = (squares / scale).mean(axis=2)
    draw = np.random.default_rng(SEED)
    chosen = draw.integers(len(full), size=(BOOTSTRAPS, len(full)))
    ratios = np.sqrt(short[chosen].mean(axis=1) / full[chosen].mean(axis=1))
    low, high = np.quantile(ratios, [0.05, 0.95])
    ratio = float(np.sqrt(short.mean() / full.mean()))
    return Point(sensor, temperatures, poses, prior, ratio, (float(low), float(high)))


def shortest(curve: Curve) -> tuple[int, int] | None:
    """Return temperatures and poses of the shortest campaign that is good enough in every sensor.

    Good enough: a ratio of at most GOOD_ENOUGH. Poses cost more than temperatures: each is a run
    of its own. None where nothing on the curve is.
    """
    sensors = {point.sensor for point in curve.points}
    fine = [
        (point.poses, point.temperatures)
        for point in curve.points
        if point.prior and point.ratio <= GOOD_ENOUGH
    ]
    enough = [pair for pair in sorted(set(fine)) if fine.count(pair) == len(sensors)]
    return (enough[0][1], enough[0][0]) if enough else None


def curve_content(curve: Curve) -> dict[str, Any]:
    """Return the curve and its shortest campaign as plain values."""
    found = shortest(curve)
    return {
        'good_enough': GOOD_ENOUGH,
        'devices': curve.devices,
        'dwell_s': curve.dwell_s,
        'targets': {str(count): values for count, values in curve.targets.items()},
        'points': [asdict(point) for point in curve.points],
        'shortest': found and {'temperatures': found[0], 'poses': found[1]},
    }
