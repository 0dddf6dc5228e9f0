# SPDX-License-Identifier: Apache-2.0
"""The course of a run through the stages of its steps, all being well. No I/O.

Every change of the progress goes through `_note`: the note leaves before what it announces.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from chamber_profile import sequence_types as kinds
from chamber_profile.chamber_orders import OBEDIENCE_S, ChamberOrders
from chamber_profile.profile import Profile, Step
from chamber_profile.sequence_types import Action, Note, Progress, Readings, Switch
from chamber_profile.setpoint_program import Heading, advanced
from chamber_profile.step_clock import StepClock
from chamber_profile.unroll import closed_steps

SAFE_BAND_C = 2.0
"""So near a temperature the chamber may be opened or switched off [K]."""


class StepCourse:
    """Where a run is, and how it goes on from step to step."""

    def __init__(
        self, profile: Profile, resolution_c: float, progress: Progress, patience: float
    ) -> None:
        self.profile = profile
        self.steps = closed_steps(profile)
        self.progress = progress
        self._patience = patience
        self._now = float('-inf')
        self._orders = ChamberOrders.within(profile.limits, resolution_c, patience)
        self._clock = StepClock(self.step, None, 0.0)

    @property
    def step(self) -> Step:
        """The step the run is in."""
        return self.steps[self.progress.step]

    @property
    def dwelt_s(self) -> float:
        """Time on the present dwell's clock [s]."""
        return self._clock.dwelt_s

    def _run(self, readings: Readings, elapsed: float) -> list[Action]:
        stage = self.progress.stage
        if stage == kinds.MOVE and self._orders.started:
            return self._move(readings, elapsed)
        if stage == kinds.SETTLE:
            return self._settle(readings)
        if stage == kinds.DWELL:
            return self._dwell(readings, elapsed)
        if stage == kinds.STOP:
            return self._stop(readings, 'done', kinds.DONE)
        return []

    def _move(self, readings: Readings, elapsed: float) -> list[Action]:
        step = self.step
        setpoint = self._advance(elapsed)
        actions: list[Action] = []
        rate = self._clock.ramp_deviation(self._now, readings, setpoint)
        if rate is not None:
            actions += self._note('ramp_rate', measured=rate, nominal=step.rate_c_per_min)
        if setpoint != step.target_c:
            return actions
        return actions + (
            self._next_step() if step.kind == 'ramp' else self._enter_stage(kinds.SETTLE)
        )

    def _settle(self, readings: Readings) -> list[Action]:
        rule = self.step.stabilise
        if rule is None:
            return self._settle_for_opening(readings)
        if self._clock.settled(self._now, readings):
            waited = round(self._now - self._clock.since, 3)
            return self._enter_stage(kinds.DWELL, settled_after_s=waited)
        reason = self._clock.overdue(self._now)
        if not reason:
            return []
        if rule.on_timeout == 'continue':
            return self._enter_stage(kinds.DWELL, not_settled=reason)
        if rule.on_timeout == 'hold':
            return self._note('pause', mode=kinds.PAUSED, reason=reason)
        return self._go_safe(reason)

    def _settle_for_opening(self, readings: Readings) -> list[Action]:
        """Ask to open only when air and device are as warm as the room: no condensation."""
        floor = self.profile.ambient_c - 1.0
        known = [value for value in (readings.air, readings.device) if value is not None]
        if readings.air is None or min(known) < floor:
            return []
        if abs(readings.air - self.step.target_c) > SAFE_BAND_C:
            return []
        return self._enter_stage(kinds.CONFIRM, prompt=self.step.prompt)

    def _dwell(self, readings: Readings, elapsed: float) -> list[Action]:
        lost = self._clock.dwell(elapsed, readings)
        if lost:
            return self._note('dwell_restart', lost_s=round(lost, 3))
        return self._next_step() if self._clock.dwelt_enough else []

    def _next_step(self) -> list[Action]:
        if self.progress.step + 1 < len(self.steps):
            return self._enter('step', self.progress.step + 1)
        return self._enter_stage(kinds.STOP)

    def _enter(self, event: str, number: int, mode: str = '') -> list[Action]:
        step = self.steps[number]
        self._clock = StepClock(step, self.progress.setpoint, self._now)
        stays = self.progress.setpoint == step.target_c and self._orders.started
        stage = kinds.SETTLE if stays and step.kind != 'ramp' else kinds.MOVE
        mode = mode or self.progress.mode
        return self._note(event, mode=mode, step=number, stage=stage, reason='')

    def _enter_stage(self, stage: str, **details: Any) -> list[Action]:
        self._clock.enter_stage(self._now)
        return self._note('stage', stage=stage, **details)

    def _go_on(self, event: str, mode: str) -> list[Action]:
        """Leave PAUSED or HOLD_FAULT."""
        settling = self.progress.stage == kinds.SETTLE
        here = self.progress.setpoint
        self._clock = self._clock.after_break(here, self._now, settling=settling)
        reason = self.progress.reason if mode == kinds.PAUSED else ''
        return self._note(event, mode=mode, reason=reason)

    def _take_over(self, readings: Readings) -> None:
        """Go on from the air's temperature: nothing may jump. The chamber is to be started."""
        if readings.air is not None:
            limits = self.profile.limits
            here = min(max(readings.air, limits.air_min_c), limits.air_max_c)
            self.progress = replace(self.progress, setpoint=here)
        self._orders.begin(self._now)

    def _go_safe(self, reason: str) -> list[Action]:
        self._clock.since = self._now
        return self._note('safe', mode=kinds.SAFE, stage=kinds.MOVE, reason=reason, aborting=True)

    def _stop(self, readings: Readings, event: str, mode: str) -> list[Action]:
        if readings.running is False and readings.link == kinds.LINK_OK:
            return self._note(event, mode=mode)
        if self._now - self._clock.since > OBEDIENCE_S * self._patience:
            reason = self.progress.reason or 'the run was complete'
            reason += '; the chamber did not confirm stand-by'
            return [
                *self._note('aborted', mode=kinds.ABORTED, reason=reason),
                Switch(False),
            ]
        return []

    def _heading(self) -> Heading:
        mode, stage = self.progress.mode, self.progress.stage
        if mode == kinds.SAFE:
            return Heading(self.profile.on_abort.target_c, self.profile.on_abort.rate_c_per_min)
        moving = mode == kinds.RUN and stage == kinds.MOVE and self._orders.started
        return Heading(self.step.target_c, self.step.rate_c_per_min if moving else 0.0)

    def _advance(self, elapsed: float) -> float | None:
        if self.progress.setpoint is not None:
            setpoint = advanced(self.progress.setpoint, self._heading(), elapsed)
            self.progress = replace(self.progress, setpoint=setpoint)
        return self.progress.setpoint

    def _note(self, event: str, **changes: Any) -> list[Action]:
        names = ('mode', 'step', 'stage', 'reason', 'aborting')
        own = {name: value for name, value in changes.items() if name in names}
        self.progress = replace(self.progress, **own)
        details = {name: value for name, value in changes.items() if name not in names}
        return [Note(event, self.progress, details)]
