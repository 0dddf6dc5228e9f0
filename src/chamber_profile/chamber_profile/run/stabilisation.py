# SPDX-License-Identifier: Apache-2.0
"""Stabilisation, ramp rate and dwell time of one step (IEC 60068-2-14)."""

from __future__ import annotations

from collections import deque

from chamber_profile.profile.values import Stabilisation, Step
from chamber_profile.run.values import Readings

RAMP_WINDOW_S = 300.0
"""Averaging time of ramp rates (IEC 60068-2-14 Nb: at most 5 min) [s]."""
RAMP_TOLERANCE = 0.2
"""Largest relative deviation from the nominal ramp rate (IEC 60068-2-14 Nb)."""
RAMP_END_SHARE = 0.1
"""Share of a ramp's span that its mean rate leaves out at either end."""


class StabilisationMonitor:
    """Whether a temperature has stayed within the band and changes slowly enough.

    >>> monitor = StabilisationMonitor(Stabilisation(band_c=0.5, hold_s=60))
    >>> [monitor.settled(t, value, 20.0) for t, value in ((0, 21), (10, 20.4), (70, 20.1))]
    [False, False, True]
    """

    def __init__(self, criterion: Stabilisation) -> None:
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


class RampRateMonitor:
    """Whether the air follows a ramp: its mean rate between 10 % and 90 % of the span.

    >>> monitor = RampRateMonitor(20.0, 50.0, 2.0)
    >>> rates = [monitor.deviation(t, 20 + t / 60 * 1.5, 20 + t / 30) for t in range(0, 900, 10)]
    >>> [rate for rate in rates if rate is not None][0]
    1.5
    """

    def __init__(self, start_c: float, target_c: float, rate_c_per_min: float) -> None:
        span = target_c - start_c
        self.nominal = rate_c_per_min if span > 0 else -rate_c_per_min
        edges = (start_c + RAMP_END_SHARE * span, target_c - RAMP_END_SHARE * span)
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
        first_time, first = self._history[0]
        if time - first_time < self._window or self._window < 60.0:
            return None
        rate = (air - first) / (time - first_time) * 60.0
        if abs(rate - self.nominal) <= RAMP_TOLERANCE * abs(self.nominal):
            return None
        self._reported = True
        return round(rate, 6)


class StepTimer:
    """Times one stage of a step, from `now` on; `setpoint` is the programmed temperature [°C]."""

    def __init__(self, step: Step, setpoint: float | None, now: float) -> None:
        self.step = step
        self.since = now
        """When the stage was entered [s]."""
        self.dwelt_s = 0.0
        """Time on the dwell clock [s]."""
        self._stabilisation = StabilisationMonitor(step.stabilise) if step.stabilise else None
        self._ramp_rate = None
        if step.kind == 'ramp' and setpoint is not None and setpoint != step.target_c:
            self._ramp_rate = RampRateMonitor(setpoint, step.target_c, step.rate_c_per_min)

    def enter_stage(self, now: float) -> None:
        """Begin another stage of the same step."""
        self.since, self.dwelt_s = now, 0.0

    def after_interruption(
        self, setpoint: float | None, now: float, *, settling: bool
    ) -> StepTimer:
        """Return the timer after a pause or a fault: stabilisation and ramp rate start anew."""
        fresh = StepTimer(self.step, setpoint, now if settling else self.since)
        fresh.dwelt_s = self.dwelt_s
        return fresh

    def ramp_deviation(
        self, now: float, readings: Readings, setpoint: float | None
    ) -> float | None:
        """Return the ramp's mean rate [°C/min] the first time it is out of tolerance."""
        if self._ramp_rate is None or setpoint is None:
            return None
        return self._ramp_rate.deviation(now, readings.air, setpoint)

    def settled(self, now: float, readings: Readings) -> bool:
        """Take a reading; return whether the stabilisation criterion is met."""
        if self._stabilisation is None:
            return True
        return self._stabilisation.settled(now, self._temperature(readings), self.step.target_c)

    def timeout_reason(self, now: float) -> str:
        """Return what has not stabilised within the time allowed; '' before."""
        criterion = self.step.stabilise
        if criterion is None or now - self.since < criterion.timeout_s:
            return ''
        target = f'{self.step.target_c:g} °C'
        return (
            f'{criterion.source} not within {criterion.band_c:g} K of {target} '
            f'after {criterion.timeout_s:g} s'
        )

    def dwell(self, elapsed: float, readings: Readings) -> float:
        """Advance the dwell clock as `dwell_mode` says; return the time a restart discards [s]."""
        step = self.step
        runs = step.dwell_mode == 'free' or self._stabilisation is None
        if self._stabilisation is not None and not runs:
            runs = self._stabilisation.in_band(self._temperature(readings), step.target_c)
        if runs:
            self.dwelt_s += elapsed
        elif step.dwell_mode == 'restart':
            discarded, self.dwelt_s = self.dwelt_s, 0.0
            return discarded
        return 0.0

    @property
    def dwell_complete(self) -> bool:
        """Whether the dwell has lasted as long as the step asks for."""
        return self.dwelt_s >= self.step.dwell_s - 1e-6

    def _temperature(self, readings: Readings) -> float | None:
        source = self.step.stabilise.source if self.step.stabilise else 'air'
        return readings.air if source == 'air' else readings.device
