# SPDX-License-Identifier: Apache-2.0
"""What a sequencer may tell a chamber, and when."""

from __future__ import annotations

from dataclasses import dataclass, field

from chamber_profile.profile.unroll import closed_steps
from chamber_profile.profile.values import Profile, Step
from chamber_profile.run.values import (
    CONFIRM,
    CONTROLLING,
    FINISHED,
    PAUSED,
    RUN,
    SAFE,
    STOP,
    Note,
    ProgramLimits,
    Progress,
    Readings,
    Switch,
    WriteSetpoint,
)

GAP_S = 4.98
RESPONSE_TIMEOUT_S = 60.0


@dataclass
class OrderWatch:
    """Limits, set-points and switches: in order, in time, within limits and rates."""

    profile: Profile
    resolution: float = 0.1
    """Step of the set-point the chamber can express [K]."""
    programs_limits: bool = True
    time: float = float('-inf')
    written: tuple[float, float] | None = None
    """When and what was written last [s, °C]."""
    ours: bool = False
    """Whether anything was ever written."""
    limited: bool = False
    """Whether this process has given its limits to the chamber."""
    told: bool = False
    """Whether it has written a set-point since it took the chamber over."""
    confirmed: bool = False
    """Whether the chamber has shown since then that it runs."""
    astray: float | None = None
    """Since when the chamber holds another set-point than it was told [s]."""
    stopping: float | None = None
    """Since when the chamber runs although it is to stop, untold [s]."""
    steps: tuple[Step, ...] = field(init=False)

    def __post_init__(self) -> None:
        self.steps = closed_steps(self.profile)

    def restarted(self) -> None:
        """The process was killed and begun again: what it knew by heart is gone."""
        self.limited = self.told = self.confirmed = False
        self.time, self.written, self.astray = float('-inf'), None, None

    def heading(self, progress: Progress) -> tuple[float, float]:
        """Where the programmed temperature goes, and how fast [°C, °C/min]."""
        if progress.mode == SAFE:
            return self.profile.on_abort.target_c, self.profile.on_abort.rate_c_per_min
        step = self.steps[progress.step]
        return step.target_c, step.rate_c_per_min if progress.mode == RUN else 0.0

    def look_at_orders(
        self, before: Progress, readings: Readings, actions: list, after: Progress
    ) -> None:
        self._must_obey(before, readings, after)
        if readings.link != 'ok':
            self.told = False  # what was written last may not have arrived
        for action in actions:
            if isinstance(action, ProgramLimits):
                limits = self.profile.limits
                assert (action.low_c, action.high_c) == (limits.air_min_c, limits.air_max_c)
                assert self.programs_limits
                self.limited = True
            elif isinstance(action, WriteSetpoint):
                self._write(action.temperature_c, after)
            elif isinstance(action, Switch) and action.on:
                assert after.mode in (RUN, PAUSED), 'started although it is not to run'
                assert after.stage not in (CONFIRM, STOP)
                assert self.told, 'started before it was told a set-point'
                assert not self.confirmed, 'started again although it was stopped'
            elif isinstance(action, Note) and action.event == 'limits':
                assert action.details['programmed'] is self.programs_limits
                self.limited = self.limited or not self.programs_limits
        if after.mode in (RUN, PAUSED) and after.stage not in (CONFIRM, STOP):
            self.confirmed = self.confirmed or bool(readings.running and self.told)
        if after.mode in FINISHED and before.mode in CONTROLLING and 'at once' in after.reason:
            assert Switch(False) in actions, 'left on'
        self._must_stop(readings, actions, after)

    def _must_stop(self, readings: Readings, actions: list, after: Progress) -> None:
        """At a prompt and at the end the chamber is told to stop until it does."""
        idle = after.mode in (RUN, SAFE) and after.stage in (CONFIRM, STOP)
        if not idle or Switch(False) in actions or readings.running is False:
            self.stopping = None
        elif self.stopping is None:
            self.stopping = self.time
        else:
            assert self.time - self.stopping <= 15.0, 'not told to stop'
        if after.mode in FINISHED and 'at once' in after.reason:
            assert (after.reason and Switch(False) in actions) or self.time == float('-inf')

    def _must_obey(self, before: Progress, readings: Readings, after: Progress) -> None:
        """A chamber that holds another set-point for long is brought to safety."""
        holds = before.mode in (RUN, PAUSED) and before.stage not in (CONFIRM, STOP)
        known = self.written is not None and readings.setpoint is not None and self.confirmed
        apart = abs(readings.setpoint - self.written[1]) if holds and known else 0.0
        if apart <= 0.75 * self.resolution:
            self.astray = None
        elif self.astray is None:
            self.astray = self.time
        else:
            late = self.time - self.astray > RESPONSE_TIMEOUT_S + 20.0
            assert after.mode == SAFE or not late, 'the chamber does as it likes'

    def _write(self, value: float, after: Progress) -> None:
        limits = self.profile.limits
        assert limits.air_min_c - 1e-9 <= value <= limits.air_max_c + 1e-9
        assert self.limited or after.mode == SAFE, 'written before the limits were programmed'
        assert after.setpoint is not None
        _, rate = self.heading(after)
        edge = min(value - limits.air_min_c, limits.air_max_c - value) < self.resolution
        rounded = self.resolution if edge else self.resolution / 2.0
        far = abs(value - after.setpoint)
        step = float('inf')
        if self.written is not None:  # where the way turns round, a write is no larger a step
            passed = self.time - self.written[0]
            step = abs(value - self.written[1]) - rate / 60.0 * passed
        assert min(far - rate / 60.0 * 2.5, step) <= rounded + 1e-6, (value, after, rate)
        if self.written is not None:
            assert self.time - self.written[0] >= GAP_S - 1e-9, 'written too soon'
        self.written = (self.time, value)
        self.told = self.ours = True
