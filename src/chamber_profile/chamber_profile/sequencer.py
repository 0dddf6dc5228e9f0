# SPDX-License-Identifier: Apache-2.0
"""The sequencer: profile + clock + readings → set-points, switches and journal notes. No I/O.

`tick` is called about once a second with what is known; it returns actions to be carried out in
order. A `Note` comes before the actions it announces, so that the journal always knows at least
as much as the chamber. A command that did not reach the chamber shows as a failing link and is
given again.
"""

from __future__ import annotations

from dataclasses import replace

from chamber_profile import sequence_types as kinds
from chamber_profile.profile import Profile
from chamber_profile.sequence_types import Action, Progress, Readings, Switch
from chamber_profile.step_course import SAFE_BAND_C, StepCourse
from chamber_profile.supervision import check_problems, trip_reason

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
