# SPDX-License-Identifier: Apache-2.0
"""Decide when the temperature has settled, and whether a ramp is as steep as it should be."""

from __future__ import annotations

from collections import deque

from chamber_profile.profile import Stabilise

RAMP_WINDOW_S = 300.0
"""Ramp rates are means over this time (IEC 60068-2-14 Nb: at most 5 min) [s]."""
RAMP_TOLERANCE = 0.2
"""… and may differ from the nominal rate by this share."""
RAMP_EDGE = 0.1
"""The first and last tenth of a ramp's span do not count."""


class Settling:
    """Watch a temperature until it has stayed near the set-point, and hardly moves.

    >>> settling = Settling(Stabilise(band_c=0.5, hold_s=60))
    >>> [settling.settled(t, value, 20.0) for t, value in ((0, 21), (10, 20.4), (70, 20.1))]
    [False, False, True]
    """

    def __init__(self, criterion: Stabilise) -> None:
        self.criterion = criterion
        self._inside_since: float | None = None
        self._history: deque[tuple[float, float]] = deque()

    def in_band(self, value: float | None, setpoint: float) -> bool:
        """Return whether the value is within the band now."""
        return value is not None and abs(value - setpoint) <= self.criterion.band_c

    def settled(self, time: float, value: float | None, setpoint: float) -> bool:
        """Take one reading; return whether the criterion is met now."""
        if value is not None:
            self._history.append((time, value))
            while self._history[0][0] < time - self.criterion.rate_window_s:
                if len(self._history) > 1 and self._history[1][0] > (
                    time - self.criterion.rate_window_s
                ):
                    break
                self._history.popleft()
        if not self.in_band(value, setpoint):
            self._inside_since = None
            return False
        if self._inside_since is None:
            self._inside_since = time
        return time - self._inside_since >= self.criterion.hold_s and self._is_slow(time)

    def _is_slow(self, time: float) -> bool:
        limit = self.criterion.max_rate_c_per_min
        if limit is None:
            return True
        first_time, first = self._history[0]
        if time - first_time < self.criterion.rate_window_s:
            return False
        rate = (self._history[-1][1] - first) / (time - first_time) * 60.0
        return abs(rate) <= limit


class RampWatch:
    """Compare the air's mean rate with the nominal one between 10 % and 90 % of a ramp.

    >>> watch = RampWatch(20.0, 50.0, 2.0)
    >>> rates = [watch.deviation(t, 20 + t / 60 * 1.5, 20 + t / 30) for t in range(0, 900, 10)]
    >>> [rate for rate in rates if rate is not None][0]
    1.5
    """

    def __init__(self, start_c: float, target_c: float, rate_c_per_min: float) -> None:
        span = target_c - start_c
        self.nominal = rate_c_per_min if span > 0 else -rate_c_per_min
        edges = (start_c + RAMP_EDGE * span, target_c - RAMP_EDGE * span)
        self._low, self._high = min(edges), max(edges)
        self._window = min(RAMP_WINDOW_S, 0.75 * abs(edges[1] - edges[0]) / rate_c_per_min * 60.0)
        self._history: deque[tuple[float, float]] = deque()
        self._reported = False

    def deviation(self, time: float, air: float | None, setpoint: float) -> float | None:
        """Return the mean rate [°C/min] the first time it is outside the tolerance, else None."""
        if air is None or self._reported or not self._low <= setpoint <= self._high:
            return None
        self._history.append((time, air))
        while len(self._history) > 1 and self._history[1][0] <= time - self._window:
            self._history.popleft()
        then, before = self._history[0]
        if time - then < self._window or self._window < 60.0:
            return None
        rate = (air - before) / (time - then) * 60.0
        if abs(rate - self.nominal) <= RAMP_TOLERANCE * abs(self.nominal):
            return None
        self._reported = True
        return round(rate, 6)
