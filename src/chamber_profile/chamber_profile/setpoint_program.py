# SPDX-License-Identifier: Apache-2.0
"""Where the programmed temperature is, and which set-point to write for it and when."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

WRITE_PERIOD_S = 5.0
"""Set-points are written at most so often: register wear, load on the bus [s]."""
JITTER_S = 0.02
"""… give or take a clock tick that comes a little early [s]."""


@dataclass(frozen=True)
class Heading:
    """Where the programmed temperature goes, and how fast."""

    target_c: float
    rate_c_per_min: float
    """0: it stands."""


def advanced(setpoint: float, heading: Heading, seconds: float) -> float:
    """Return the programmed temperature `seconds` later [°C].

    >>> advanced(20.0, Heading(-10.0, 2.0), 60.0), advanced(-9.9, Heading(-10.0, 2.0), 60.0)
    (18.0, -10.0)
    """
    change = heading.rate_c_per_min / 60.0 * seconds
    apart = heading.target_c - setpoint
    if heading.rate_c_per_min > 0.0 and abs(apart) <= change * (1.0 + 1e-9):
        return heading.target_c
    return setpoint + math.copysign(change, apart)


@dataclass(frozen=True)
class SetpointWriter:
    """Decides when which set-point is written, at the resolution of the protocol.

    Halfway between two writes the written value is the programmed one: it is never further from
    the ideal ramp than rate × 2.5 s plus half the resolution.
    """

    resolution_c: float
    low_c: float
    high_c: float
    written: float | None = None
    """What the chamber was last told; None: unknown, to be told (again)."""
    written_at: float = -math.inf

    def forgotten(self) -> SetpointWriter:
        """Return the writer that does not rely on its last write having arrived."""
        return replace(self, written=None)

    def due(self, now: float, setpoint: float, heading: Heading) -> float | None:
        """Return the set-point to write now [°C], None where there is nothing to write."""
        if now - self.written_at < WRITE_PERIOD_S - JITTER_S:
            return None
        ahead = advanced(setpoint, heading, WRITE_PERIOD_S / 2)
        value = self._quantised(self._within_rate(ahead, now, heading))
        return None if value == self.written else value

    def after(self, now: float, value: float) -> SetpointWriter:
        """Return the writer after the value was written."""
        return replace(self, written=value, written_at=now)

    def _within_rate(self, value: float, now: float, heading: Heading) -> float:
        """Where the way turns round, looking ahead must not make the written step too large."""
        if self.written is None or not heading.rate_c_per_min:
            return value
        passed = heading.rate_c_per_min / 60.0 * (now - self.written_at)
        most = passed + self.resolution_c / 2 + 1e-6
        return min(max(value, self.written - most), self.written + most)

    def _quantised(self, value: float) -> float:
        steps = round(value / self.resolution_c)
        if steps * self.resolution_c > self.high_c + 1e-9:
            steps -= 1
        elif steps * self.resolution_c < self.low_c - 1e-9:
            steps += 1
        return round(steps * self.resolution_c, 6)
