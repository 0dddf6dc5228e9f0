# SPDX-License-Identifier: Apache-2.0
"""The sequencer: profile + clock + readings → set-points, switches and journal notes. No I/O.

`tick` is called about once a second with what is known; it returns actions to be carried out in
order. A `Note` comes before the actions it announces, so that the journal always knows at least
as much as the chamber. A command that did not reach the chamber shows as a failing link and is
given again.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from chamber_profile.profile.unroll import closed_steps
from chamber_profile.profile.values import Profile, Step
from chamber_profile.run import values as kinds
from chamber_profile.run.orders import OBEDIENCE_S, ChamberOrders, Heading, advanced
from chamber_profile.run.stabilisation import StepClock
from chamber_profile.run.supervision import check_problems, trip_reason
from chamber_profile.run.values import Action, Note, Progress, Readings, Switch

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


LONGEST_TICK_S = 10.0
"""A longer gap between two ticks counts as this: the programmed temperature never jumps [s]."""
CHECK_S = 30.0
"""How long the checks before a start may take until all is well [s]."""

COMMANDS = ('start', 'pause', 'resume', 'abort', 'confirm')
"""What an operator can order; `standby` (at once, no ramp) is for the second interrupt."""
ENDINGS = ('abort', 'standby')
"""Orders that no other takes back."""


class Sequencer(StepCourse):
    """One run of a profile. `progress` says where it is; give it back to continue a run.

    Commands return why they are refused, '' where they are not; they act at the next `tick`.
    `patience` stretches what the chamber may take to answer, start and stop (in the sequencer's
    time): the factor by which that clock is accelerated.
    """

    def __init__(
        self,
        profile: Profile,
        resolution_c: float = 0.1,
        progress: Progress | None = None,
        *,
        patience: float = 1.0,
    ) -> None:
        super().__init__(profile, resolution_c, progress or Progress(), patience)
        self._resumed = progress is not None
        self._command = ''
        self._held = kinds.RUN  # the mode that HOLD_FAULT interrupts
        self._programs_limits = True
        self._protected = False  # whether the chamber has our limits

    # What is going on -------------------------------------------------------------------------

    @property
    def in_charge(self) -> bool:
        """Whether a run is under way: the chamber depends on us."""
        return self.progress.mode not in (kinds.IDLE, *kinds.FINISHED)

    def suit(self, *, resolution_c: float, programs_limits: bool) -> None:
        """Keep to what the protocol can express [K], and to whether it knows limits."""
        self._orders.writer = replace(self._orders.writer, resolution_c=resolution_c)
        self._programs_limits = programs_limits

    @property
    def prompt(self) -> str:
        """What the operator is asked for now; '' nothing."""
        waiting = self.progress.mode == kinds.RUN and self.progress.stage == kinds.CONFIRM
        return self.step.prompt if waiting else ''

    def command(self, name: str) -> str:
        """Take a command for the next tick; return why it is refused, '' where it is not."""
        refusal = self.refusal(name)
        if not refusal and self._command in ENDINGS and name not in ENDINGS:
            refusal = f'{name}: the run is being ended ({self._command})'
        if not refusal and self._command != 'standby':
            self._command = name
        return refusal

    def refusal(self, name: str) -> str:
        """Return why the command makes no sense now; '' where it does."""
        mode = self.progress.mode
        allowed = {
            'start': mode == kinds.IDLE,
            'pause': mode == kinds.RUN,
            'resume': mode == kinds.PAUSED,
            'abort': mode not in (kinds.SAFE, *kinds.FINISHED),
            'confirm': bool(self.prompt),
            'standby': mode not in kinds.FINISHED,
        }[name]
        return '' if allowed else f'{name}: the run is {mode}, stage {self.progress.stage}'

    # The tick ---------------------------------------------------------------------------------

    def tick(self, readings: Readings) -> list[Action]:
        """Return what is to be done now, in order."""
        before, self._now = self._now, max(readings.time, self._now)
        elapsed = min(self._now - before, LONGEST_TICK_S) if before > float('-inf') else 0.0
        mode = self.progress.mode
        actions = self._obey(readings)
        if self.progress.mode in kinds.IN_CHARGE:
            actions += self._watch_over(readings)
        if self.progress.mode != mode:
            elapsed = 0.0  # what passed was no time of this mode
        if self.progress.mode == kinds.CHECK:
            actions += self._check(readings)
        elif self.progress.mode == kinds.RUN:
            actions += self._run(readings, elapsed)
        elif self.progress.mode == kinds.SAFE:
            actions += self._make_safe(readings, elapsed)
        return actions + self._drive(readings)

    def _obey(self, readings: Readings) -> list[Action]:
        name, self._command = self._command, ''
        if not name or self.refusal(name):
            return []
        if name == 'start':
            if self.progress.aborting:
                self._take_over(readings)
                return self._go_safe(self.progress.reason)
            self._clock.since, self._protected = self._now, False
            return self._note('start', mode=kinds.CHECK, reason='')
        if name == 'pause':
            return self._note('pause', mode=kinds.PAUSED, reason='by the operator')
        if name == 'resume':
            return self._go_on('resume', kinds.RUN)
        if name == 'confirm':
            note = self._note('confirm')
            self._take_over(readings)
            return note + self._next_step()
        if name == 'abort':
            return self._abort(readings)
        note = self._note('aborted', **_over('stand-by at once'))
        return [*note, Switch(False)]

    def _abort(self, readings: Readings) -> list[Action]:
        """Make safe what is ours: a run under way, or a chamber that an interrupted run left."""
        reason = 'aborted by the operator'
        if self.progress.mode not in kinds.IN_CHARGE:
            if not self._resumed or readings.running is False:
                return self._note('aborted', **_over(reason))
            self._take_over(readings)
        return self._go_safe(reason)

    def _check(self, readings: Readings) -> list[Action]:
        problems = check_problems(self.profile, self.steps, readings)
        if not problems and self._protected:
            interruptions = self.progress.interruptions + (1 if self._resumed else 0)
            self.progress = replace(self.progress, interruptions=interruptions)
            self._take_over(readings)
            event = 'interrupted' if self._resumed else 'run'
            return self._enter(event, self.progress.step, mode=kinds.RUN)
        if not problems:
            self._protected = True
            return self._protect()
        self._protected = False
        if self._now - self._clock.since < CHECK_S * self._patience:
            return []
        reason = f'check failed: {"; ".join(problems)}'
        if self._resumed and readings.running:
            self._take_over(readings)
            return self._go_safe(reason)
        mode = kinds.IDLE if self._resumed else kinds.ABORTED
        return self._note('check_failed', mode=mode, reason=reason)

    def _protect(self) -> list[Action]:
        """Program the profile's limits into the chamber, or say that they are not there."""
        low, high = self.profile.limits.air_min_c, self.profile.limits.air_max_c
        if self._programs_limits:
            note = self._note('limits', low_c=low, high_c=high, programmed=True)
            return [*note, kinds.ProgramLimits(low, high)]
        warning = (
            f'this protocol programs no limits: set {low:g} … {high:g} °C at the chamber; '
            'until then only this program watches over them'
        )
        return self._note('limits', low_c=low, high_c=high, programmed=False, warning=warning)

    # Faults and the safe state ----------------------------------------------------------------

    def _watch_over(self, readings: Readings) -> list[Action]:
        """Hold while the link fails; go to the safe state when something is really wrong."""
        if readings.link != kinds.LINK_OK:
            self._orders.distrust()
            if readings.link == kinds.LINK_LOST:
                return self._go_safe('the chamber does not answer')
            if self.progress.mode == kinds.HOLD_FAULT:
                return []
            self._held = self.progress.mode
            return self._note('hold', mode=kinds.HOLD_FAULT)
        actions: list[Action] = []
        if self.progress.mode == kinds.HOLD_FAULT:
            actions += self._go_on('recovered', self._held)
        waiting = self.progress.stage in (kinds.CONFIRM, kinds.STOP)
        reason = trip_reason(self.profile, readings, waiting=waiting)
        if not reason and not waiting:
            reason = self._orders.disobedience(self._now, readings)
        return actions + (self._go_safe(reason) if reason else [])

    def _make_safe(self, readings: Readings, elapsed: float) -> list[Action]:
        """To the safe temperature at the safe rate, then stop; never start a stopped chamber."""
        if readings.link != kinds.LINK_OK:
            self._orders.distrust()
        if self.progress.stage == kinds.STOP:
            return self._stop(readings, 'aborted', kinds.ABORTED)
        safe = self.profile.on_abort
        setpoint = self._advance(elapsed)
        if readings.running is False or setpoint is None:  # told all the same: it may be mistaken
            return [*self._enter_stage(kinds.STOP), Switch(False)]
        there = setpoint == safe.target_c and self._orders.told(setpoint)
        if there and readings.air is not None and abs(readings.air - setpoint) <= SAFE_BAND_C:
            return self._enter_stage(kinds.STOP, air=readings.air)
        low, high = self.profile.limits.air_min_c, self.profile.limits.air_max_c
        allowed = (high - low) / safe.rate_c_per_min * 60.0 + safe.timeout_s
        if self._now - self._clock.since <= allowed:
            return []
        return self._enter_stage(kinds.STOP, not_safe=f'not at {safe.target_c:g} °C in time')

    # The chamber ------------------------------------------------------------------------------

    def _drive(self, readings: Readings) -> list[Action]:
        """Write the set-point where it is due, then see to it that the chamber runs or stops."""
        mode, setpoint = self.progress.mode, self.progress.setpoint
        if mode not in (kinds.RUN, kinds.PAUSED, kinds.SAFE):
            return []
        if self.progress.stage in (kinds.CONFIRM, kinds.STOP):
            return self._orders.keep_stopped(self._now, readings)
        actions: list[Action] = []
        if setpoint is not None:
            actions += self._orders.set_point(self._now, setpoint, self._heading())
        if mode != kinds.SAFE:
            actions += self._orders.keep_running(self._now, readings)
        return actions


def _over(reason: str) -> dict[str, str]:
    return {'mode': kinds.ABORTED, 'stage': kinds.STOP, 'reason': reason}
