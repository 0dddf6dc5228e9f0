# SPDX-License-Identifier: Apache-2.0
"""Control charts: does a coefficient drift from device to device, or from lot to lot.

Individuals and moving ranges (Shewhart; ISO 7870-2): σ = mean moving range / 1.128, limits at 3 σ;
Western Electric's rules 1 (one point beyond a limit) and 4 (eight in a row on one side).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray

MOVING_RANGE = 1.128
"""Mean range of two values of a normal distribution [σ] (d₂ for n = 2)."""
IN_A_ROW = 8


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
    # One wild value makes two wild steps: the median of ranges (d₂ → 0.954) does not see it.
    sigma = float(min(steps.mean() / MOVING_RANGE, np.median(steps) / 0.954))
    centre = float(np.median(values))
    side = np.sign(values - centre)
    row = np.convolve(side, np.ones(IN_A_ROW))[IN_A_ROW - 1 : len(values)]
    ends = np.flatnonzero(np.abs(row) == IN_A_ROW) + IN_A_ROW - 1
    beyond = np.flatnonzero(np.abs(values - centre) > 3.0 * sigma)
    return ControlChart(centre, sigma, tuple(map(int, beyond)), tuple(map(int, ends)))
