# SPDX-License-Identifier: Apache-2.0
"""How well a lot keeps limits: the process capability index of each slope.

Cpk = min(U − µ, µ − L) / 3σ with the lot's mean µ and its scatter σ from device to device; its
standard deviation is √(1/(9n) + Cpk²/(2(n − 1))) (Bissell, How reliable is your capability index,
Applied Statistics 39, 1990).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from imu_workbench.report.limits import Limit, Limits

CAPABLE = 1.33
"""Cpk from which a lot counts as capable: four standard deviations to the nearer limit."""
COVERAGE = 1.96
"""Standard deviations of a 95 % interval."""


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
        """Whether the whole interval is above CAPABLE."""
        return self.interval[0] >= CAPABLE


def capability_index(mean: float, std: float, limit: Limit) -> float:
    """Return Cpk of values about `mean` with scatter `std` [unit of the limit]; ±∞ without one.

    >>> capability_index(0.5, 0.25, Limit(-1.0, 2.0, 'm/s²/K'))
    2.0
    """
    room = min(limit.upper - mean, mean - limit.lower)
    return room / (3.0 * std) if std > 0.0 else math.copysign(math.inf, room)


def capabilities(populations: Iterable[Mapping[str, Any]], limits: Limits) -> list[Capability]:
    """Return the capability of every lot, sensor and axis that has a limit, worst first."""
    found = []
    for one in populations:
        limit = limits.of(one['sensor'], 'slope')
        if limit is None or one['devices'] < 2:
            continue
        for axis, mean, std in zip('xyz', one['mean'], one['std'], strict=True):
            cpk, n = capability_index(mean, std, limit), one['devices']
            spread = COVERAGE * math.sqrt(1.0 / (9.0 * n) + cpk**2 / (2.0 * (n - 1)))
            found.append(
                Capability(
                    one['type'],
                    one['lot'],
                    one['sensor'],
                    axis,
                    'slope',
                    n,
                    limit.lower if math.isfinite(limit.lower) else None,
                    limit.upper if math.isfinite(limit.upper) else None,
                    limit.unit,
                    cpk,
                    (cpk - spread, cpk + spread),
                )
            )
    return sorted(found, key=lambda c: c.cpk)
