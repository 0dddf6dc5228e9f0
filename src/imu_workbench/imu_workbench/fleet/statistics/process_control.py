# SPDX-License-Identifier: Apache-2.0
"""Statistical process control: does a slope keep its limits, and does it drift.

Process capability: Cpk = min(U − µ, µ − L) / 3σ with the lot's mean µ and its scatter σ between
devices; its standard deviation is √(1/(9n) + Cpk²/(2(n − 1))) (Bissell, How reliable is your
capability index, Applied Statistics 39, 1990).

Control charts of individuals and moving ranges (Shewhart; ISO 7870-2): σ = mean moving range /
1.128, limits at 3 σ; Western Electric's rules 1 (one point beyond a limit) and 4 (eight in a row
on one side).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray

from imu_workbench.report.limits import CoefficientLimit, CoefficientLimits

LEAST_CPK = 1.33
"""Cpk from which a lot counts as capable: four standard deviations to the nearer limit."""
COVERAGE_FACTOR = 1.96
"""Standard deviations of a 95 % interval."""
MEAN_MOVING_RANGE, MEDIAN_MOVING_RANGE = 1.128, 0.954
"""Mean (d₂ for n = 2) and median range of two values of a normal distribution [σ]."""
RUN_LENGTH = 8
"""Values in a row on one side of the centre that count as a drift."""


@dataclass(frozen=True)
class Capability:
    """The capability of one slope of a lot."""

    type: str
    lot: str
    sensor: str
    axis: str
    coefficient: str
    devices: int
    lower: float | None
    upper: float | None
    """Limits [unit], None where there is none."""
    unit: str
    cpk: float
    interval: tuple[float, float]
    """95 %."""

    @property
    def capable(self) -> bool:
        """Whether the whole interval is above LEAST_CPK."""
        return self.interval[0] >= LEAST_CPK


def capability_index(mean: float, std: float, limit: CoefficientLimit) -> float:
    """Return Cpk of values about `mean` with scatter `std` [unit of the limit]; ±∞ without one.

    >>> capability_index(0.5, 0.25, CoefficientLimit(-1.0, 2.0, 'm/s²/K'))
    2.0
    """
    room = min(limit.upper - mean, mean - limit.lower)
    return room / (3.0 * std) if std > 0.0 else math.copysign(math.inf, room)


def capabilities(
    populations: Iterable[Mapping[str, Any]], limits: CoefficientLimits
) -> list[Capability]:
    """Return the capability of every lot, sensor and axis that has a limit, worst first."""
    found = []
    for one in populations:
        limit = limits.of(one['sensor'], 'slope')
        if limit is None or one['devices'] < 2:
            continue
        for axis, mean, std in zip('xyz', one['mean'], one['std'], strict=True):
            cpk, n = capability_index(mean, std, limit), one['devices']
            spread = COVERAGE_FACTOR * math.sqrt(1.0 / (9.0 * n) + cpk**2 / (2.0 * (n - 1)))
            found.append(
                Capability(
                    type=one['type'],
                    lot=one['lot'],
                    sensor=one['sensor'],
                    axis=axis,
                    coefficient='slope',
                    devices=n,
                    lower=limit.lower if math.isfinite(limit.lower) else None,
                    upper=limit.upper if math.isfinite(limit.upper) else None,
                    unit=limit.unit,
                    cpk=cpk,
                    interval=(cpk - spread, cpk + spread),
                )
            )
    return sorted(found, key=lambda c: c.cpk)


@dataclass(frozen=True, eq=False)
class ControlChart:
    """A series of values in the order they were measured."""

    centre: float
    sigma: float
    beyond: tuple[int, ...]
    """Places of values beyond a limit."""
    on_one_side: tuple[int, ...]
    """Places that end a row of eight on one side of the centre."""

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper control limit."""
        return self.centre - 3.0 * self.sigma, self.centre + 3.0 * self.sigma


def control_chart(values: FloatArray) -> ControlChart:
    """Return the chart of (n,) values, two at least.

    >>> control_chart(np.array([0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 9.0])).beyond
    (6,)
    """
    steps = np.abs(np.diff(values))
    # One outlier enlarges two ranges and hardly changes their median.
    sigma = float(min(steps.mean() / MEAN_MOVING_RANGE, np.median(steps) / MEDIAN_MOVING_RANGE))
    centre = float(np.median(values))
    side = np.sign(values - centre)
    row = np.convolve(side, np.ones(RUN_LENGTH))[RUN_LENGTH - 1 : len(values)]
    ends = np.flatnonzero(np.abs(row) == RUN_LENGTH) + RUN_LENGTH - 1
    beyond = np.flatnonzero(np.abs(values - centre) > 3.0 * sigma)
    return ControlChart(centre, sigma, tuple(map(int, beyond)), tuple(map(int, ends)))
