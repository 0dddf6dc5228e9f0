# SPDX-License-Identifier: Apache-2.0
"""What is measured within one step: is the ramp steep enough, has it settled, how long dwelt."""

from __future__ import annotations

from chamber_profile.profile import Step
from chamber_profile.sequence_types import Readings
from chamber_profile.stabilisation import RampWatch, Settling


class StepClock:
    """The clock of a step's stage, from `now` on; `here` is the programmed temperature [°C]."""

    def __init__(self, step: Step, here: float | None, now: float) -> None:
        self.step = step
        self.since = now
        """When the stage was entered [s]."""
        self.dwelt_s = 0.0
        """Time on the dwell's clock [s]."""
        self._settling = Settling(step.stabilise) if step.stabilise else None
        ramp = step.kind == 'ramp' and here is not None and here != step.target_c
        self._watch = (
            RampWatch(here, step.target_c, step.rate_c_per_min)
            if ramp and here is not None
            else None
        )

    def enter_stage(self, now: float) -> None:
        """Begin another stage of the same step."""
        self.since, self.dwelt_s = now, 0.0

    def after_break(self, here: float | None, now: float, *, settling: bool) -> StepClock:
        """Return the clock after a pause or a fault: what takes time to measure starts anew."""
        fresh = StepClock(self.step, here, now if settling else self.since)
        fresh.dwelt_s = self.dwelt_s
        return fresh

    def ramp_deviation(self, now: float, readings: Readings, here: float | None) -> float | None:
        """Return the ramp's mean rate [°C/min] the first time it is out of tolerance."""
        if self._watch is None or here is None:
            return None
        return self._watch.deviation(now, readings.air, here)

    def settled(self, now: float, readings: Readings) -> bool:
        """Take a reading; return whether the dwell may begin."""
        if self._settling is None:
            return True
        return self._settling.settled(now, self._watched(readings), self.step.target_c)

    def overdue(self, now: float) -> str:
        """Return what has not settled in time; '' while there is time."""
        rule = self.step.stabilise
        if rule is None or now - self.since < rule.timeout_s:
            return ''
        target = f'{self.step.target_c:g} °C'
        return f'{rule.source} not within {rule.band_c:g} K of {target} after {rule.timeout_s:g} s'

    def dwell(self, elapsed: float, readings: Readings) -> float:
        """Let the dwell's clock run as its mode says; return what a restart lost [s]."""
        step = self.step
        inside = step.dwell_mode == 'free' or self._settling is None
        if self._settling is not None and not inside:
            inside = self._settling.in_band(self._watched(readings), step.target_c)
        if inside:
            self.dwelt_s += elapsed
        elif step.dwell_mode == 'restart':
            lost, self.dwelt_s = self.dwelt_s, 0.0
            return lost
        return 0.0

    @property
    def dwelt_enough(self) -> bool:
        """Whether the dwell is over."""
        return self.dwelt_s >= self.step.dwell_s - 1e-6

    def _watched(self, readings: Readings) -> float | None:
        source = self.step.stabilise.source if self.step.stabilise else 'air'
        return readings.air if source == 'air' else readings.device
