# SPDX-License-Identifier: Apache-2.0
"""The sequencer: profile + clock + readings → set-points, switches and journal notes. No I/O.

`tick` is called about once a second with the readings; it returns actions to be carried out in
order. A `Note` comes before the actions it announces, so that the journal always knows at least
as much as the chamber. An order that did not reach the chamber shows as a failing link and is
given again.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from chamber_profile.profile.unroll import closed_steps
from chamber_profile.profile.values import Profile, Step
from chamber_profile.run.orders import RESPONSE_TIMEOUT_S, ChamberOrders, Ramp, advanced
from chamber_profile.run.stabilisation import StepTimer
from chamber_profile.run.supervision import check_problems, trip_reason
from chamber_profile.run.values import (
    ABORTED,
    CHECK,
    CONFIRM,
    CONTROLLING,
    DONE,
    DWELL,
    FINISHED,
    HOLD_FAULT,
    IDLE,
    LINK_LOST,
    LINK_OK,
    MOVE,
    PAUSED,
    RUN,
    SAFE,
    SETTLE,
    STOP,
    Action,
    Note,
    ProgramLimits,
    Progress,
    Readings,
    Switch,
)

SAFE_BAND_K = 2.0
"""Largest distance from the target at which the chamber may be opened or switched off [K]."""
CONDENSATION_MARGIN_K = 1.0
"""Largest distance below ambient at which nothing condenses on devices [K]."""
MAX_TICK_S = 10.0
"""Longest gap between two ticks that counts: the programmed temperature never jumps [s]."""
CHECK_TIMEOUT_S = 30.0
"""Time allowed for the checks before a start to pass [s]."""

COMMANDS = ('start', 'pause', 'resume', 'abort', 'confirm')
"""Commands of an operator; `standby` (at once, no ramp) is that of the second interrupt."""
ENDING_COMMANDS = ('abort', 'standby')
"""Commands that end the run: no other command replaces them."""


class Sequencer:
    """One run of a profile. `progress` is its state; given back, the run is continued.

    `command` returns why a command is refused, '' where it is not; it takes effect at the next
    `tick`. `timeout_factor` stretches the time the chamber may take to answer, start and stop
    (in the sequencer's time): the factor by which that clock is accelerated.
    """

    def __init__(
        self,
        profile: Profile,
        resolution_c: float = 0.1,
        progress: Progress | None = None,
        *,
        timeout_factor: float = 1.0,
    ) -> None:
        self.profile = profile
        self.steps = closed_steps(profile)
        self.progress = progress or Progress()
        self._resumed = progress is not None
        self._command = ''
        self._held_mode = RUN  # the mode that HOLD_FAULT interrupts
        self._programs_limits = True
        self._limits_given = False  # whether the chamber has the profile's limits
        self._timeout_factor = timeout_factor
        self._now = float('-inf')
        self._orders = ChamberOrders.within(profile.limits, resolution_c, timeout_factor)
        self._timer = StepTimer(self.step, None, 0.0)

    # State and commands -----------------------------------------------------------------------

    @property
    def step(self) -> Step:
        """The current step."""
        return self.steps[self.progress.step]

    @property
    def dwelt_s(self) -> float:
        """Time on the dwell clock [s]."""
        return self._timer.dwelt_s

    @property
    def under_way(self) -> bool:
        """Whether a run is under way: the chamber depends on this sequencer."""
        return self.progress.mode not in (IDLE, *FINISHED)

    @property
    def prompt(self) -> str:
        """Request to the operator; '' none."""
        waiting = self.progress.mode == RUN and self.progress.stage == CONFIRM
        return self.step.prompt if waiting else ''

    def set_capabilities(self, *, resolution_c: float, programs_limits: bool) -> None:
        """Take the protocol's set-point resolution [K], and whether it can program limits."""
        self._orders.writer = replace(self._orders.writer, resolution_c=resolution_c)
        self._programs_limits = programs_limits

    def command(self, name: str) -> str:
        """Take a command for the next tick; return why it is refused, '' where it is not."""
        refusal = self.refusal(name)
        if not refusal and self._command in ENDING_COMMANDS and name not in ENDING_COMMANDS:
            refusal = f'{name}: the run is being ended ({self._command})'
        if not refusal and self._command != 'standby':
            self._command = name
        return refusal

    def refusal(self, name: str) -> str:
        """Return why the command is not possible now; '' where it is."""
        mode = self.progress.mode
        possible = {
            'start': mode == IDLE,
            'pause': mode == RUN,
            'resume': mode == PAUSED,
            'abort': mode not in (SAFE, *FINISHED),
            'confirm': bool(self.prompt),
            'standby': mode not in FINISHED,
        }[name]
        return '' if possible else f'{name}: the run is {mode}, stage {self.progress.stage}'

    # One tick ---------------------------------------------------------------------------------

    def tick(self, readings: Readings) -> list[Action]:
        """Return the actions that are due now, in order."""
        before, self._now = self._now, max(readings.time, self._now)
        elapsed = min(self._now - before, MAX_TICK_S) if before > float('-inf') else 0.0
        mode = self.progress.mode
        actions = self._apply_command(readings)
        if self.progress.mode in CONTROLLING:
            actions += self._supervise(readings)
        if self.progress.mode != mode:
            elapsed = 0.0  # the time that passed belongs to the mode before
        if self.progress.mode == CHECK:
            actions += self._check(readings)
        elif self.progress.mode == RUN:
            actions += self._run(readings, elapsed)
        elif self.progress.mode == SAFE:
            actions += self._make_safe(readings, elapsed)
        return actions + self._order_chamber(readings)

    def _apply_command(self, readings: Readings) -> list[Action]:
        name, self._command = self._command, ''
        if not name or self.refusal(name):
            return []
        match name:
            case 'start':
                return self._start(readings)
            case 'pause':
                return self._note('pause', mode=PAUSED, reason='by the operator')
            case 'resume':
                return self._leave_hold('resume', RUN)
            case 'confirm':
                note = self._note('confirm')
                self._start_from_air(readings)
                return note + self._next_step()
            case 'abort':
                return self._abort(readings)
        return [*self._end('stand-by at once'), Switch(False)]

    def _start(self, readings: Readings) -> list[Action]:
        if self.progress.aborting:
            self._start_from_air(readings)
            return self._go_safe(self.progress.reason)
        self._timer.since, self._limits_given = self._now, False
        return self._note('start', mode=CHECK, reason='')

    def _abort(self, readings: Readings) -> list[Action]:
        """Go to the safe state from a run under way, or from one that was interrupted."""
        reason = 'aborted by the operator'
        if self.progress.mode not in CONTROLLING:
            if not self._resumed or readings.running is False:
                return self._end(reason)
            self._start_from_air(readings)
        return self._go_safe(reason)

    # The checks before a start ----------------------------------------------------------------

    def _check(self, readings: Readings) -> list[Action]:
        problems = check_problems(self.profile, self.steps, readings)
        if problems:
            return self._wait_or_refuse(readings, problems)
        if not self._limits_given:
            self._limits_given = True
            return self._program_limits()
        interruptions = self.progress.interruptions + (1 if self._resumed else 0)
        self.progress = replace(self.progress, interruptions=interruptions)
        self._start_from_air(readings)
        event = 'interrupted' if self._resumed else 'run'
        return self._enter(event, self.progress.step, mode=RUN)

    def _wait_or_refuse(self, readings: Readings, problems: list[str]) -> list[Action]:
        self._limits_given = False
        if self._now - self._timer.since < CHECK_TIMEOUT_S * self._timeout_factor:
            return []
        reason = f'check failed: {"; ".join(problems)}'
        if self._resumed and readings.running:
            self._start_from_air(readings)
            return self._go_safe(reason)
        mode = IDLE if self._resumed else ABORTED
        return self._note('check_failed', mode=mode, reason=reason)

    def _program_limits(self) -> list[Action]:
        """Program the profile's limits into the chamber, or warn where the protocol cannot."""
        low, high = self.profile.limits.air_min_c, self.profile.limits.air_max_c
        if self._programs_limits:
            note = self._note('limits', low_c=low, high_c=high, programmed=True)
            return [*note, ProgramLimits(low, high)]
        warning = (
            f'this protocol programs no limits: set {low:g} … {high:g} °C at the chamber; '
            'until then only this program watches over them'
        )
        return self._note('limits', low_c=low, high_c=high, programmed=False, warning=warning)

    # The stages of a step ---------------------------------------------------------------------

    def _run(self, readings: Readings, elapsed: float) -> list[Action]:
        stage = self.progress.stage
        if stage == MOVE and self._orders.started:
            return self._move(readings, elapsed)
        if stage == SETTLE:
            return self._settle(readings)
        if stage == DWELL:
            return self._dwell(readings, elapsed)
        if stage == STOP:
            return self._stop(readings, 'done', DONE)
        return []

    def _move(self, readings: Readings, elapsed: float) -> list[Action]:
        step = self.step
        setpoint = self._advance(elapsed)
        actions: list[Action] = []
        rate = self._timer.ramp_deviation(self._now, readings, setpoint)
        if rate is not None:
            actions += self._note('ramp_rate', measured=rate, nominal=step.rate_c_per_min)
        if setpoint != step.target_c:
            return actions
        return actions + (self._next_step() if step.kind == 'ramp' else self._enter_stage(SETTLE))

    def _settle(self, readings: Readings) -> list[Action]:
        criterion = self.step.stabilise
        if criterion is None:
            return self._settle_for_opening(readings)
        if self._timer.settled(self._now, readings):
            waited = round(self._now - self._timer.since, 3)
            return self._enter_stage(DWELL, settled_after_s=waited)
        reason = self._timer.timeout_reason(self._now)
        if not reason:
            return []
        if criterion.on_timeout == 'continue':
            return self._enter_stage(DWELL, not_settled=reason)
        if criterion.on_timeout == 'hold':
            return self._note('pause', mode=PAUSED, reason=reason)
        return self._go_safe(reason)

    def _settle_for_opening(self, readings: Readings) -> list[Action]:
        """Prompt the operator once air and device are so warm that nothing condenses on them."""
        if readings.air is None:
            return []
        coldest = readings.air if readings.device is None else min(readings.air, readings.device)
        if coldest < self.profile.ambient_c - CONDENSATION_MARGIN_K:
            return []
        if abs(readings.air - self.step.target_c) > SAFE_BAND_K:
            return []
        return self._enter_stage(CONFIRM, prompt=self.step.prompt)

    def _dwell(self, readings: Readings, elapsed: float) -> list[Action]:
        discarded = self._timer.dwell(elapsed, readings)
        if discarded:
            return self._note('dwell_restart', lost_s=round(discarded, 3))
        return self._next_step() if self._timer.dwell_complete else []

    def _stop(self, readings: Readings, event: str, mode: str) -> list[Action]:
        """Wait for the chamber's stand-by, then end the run as `mode`."""
        if readings.running is False and readings.link == LINK_OK:
            return self._note(event, mode=mode)
        if self._now - self._timer.since <= RESPONSE_TIMEOUT_S * self._timeout_factor:
            return []
        reason = self.progress.reason or 'the run was complete'
        reason += '; the chamber did not confirm stand-by'
        return [*self._note('aborted', mode=ABORTED, reason=reason), Switch(False)]

    # Faults and the safe state ----------------------------------------------------------------

    def _supervise(self, readings: Readings) -> list[Action]:
        """Hold while the link fails; go to the safe state on any other fault."""
        if readings.link != LINK_OK:
            return self._hold(readings)
        actions: list[Action] = []
        if self.progress.mode == HOLD_FAULT:
            actions += self._leave_hold('recovered', self._held_mode)
        waiting = self.progress.stage in (CONFIRM, STOP)
        reason = trip_reason(self.profile, readings, waiting=waiting)
        if not reason and not waiting:
            reason = self._orders.violation(self._now, readings)
        return actions + (self._go_safe(reason) if reason else [])

    def _hold(self, readings: Readings) -> list[Action]:
        self._orders.rewrite_setpoint()
        if readings.link == LINK_LOST:
            return self._go_safe('the chamber does not answer')
        if self.progress.mode == HOLD_FAULT:
            return []
        self._held_mode = self.progress.mode
        return self._note('hold', mode=HOLD_FAULT)

    def _leave_hold(self, event: str, mode: str) -> list[Action]:
        """Leave PAUSED or HOLD_FAULT for `mode`."""
        settling = self.progress.stage == SETTLE
        setpoint = self.progress.setpoint
        self._timer = self._timer.after_interruption(setpoint, self._now, settling=settling)
        reason = self.progress.reason if mode == PAUSED else ''
        return self._note(event, mode=mode, reason=reason)

    def _go_safe(self, reason: str) -> list[Action]:
        self._timer.since = self._now
        return self._note('safe', mode=SAFE, stage=MOVE, reason=reason, aborting=True)

    def _make_safe(self, readings: Readings, elapsed: float) -> list[Action]:
        """To the safe temperature at the safe rate, then stop; never start a stopped chamber."""
        if readings.link != LINK_OK:
            self._orders.rewrite_setpoint()
        if self.progress.stage == STOP:
            return self._stop(readings, 'aborted', ABORTED)
        setpoint = self._advance(elapsed)
        if readings.running is False or setpoint is None:  # ordered all the same, to be sure
            return [*self._enter_stage(STOP), Switch(False)]
        if self._is_safe(readings, setpoint):
            return self._enter_stage(STOP, air=readings.air)
        if self._now - self._timer.since <= self._time_to_safe():
            return []
        target = self.profile.on_abort.target_c
        return self._enter_stage(STOP, not_safe=f'not at {target:g} °C in time')

    def _is_safe(self, readings: Readings, setpoint: float) -> bool:
        written = setpoint == self.profile.on_abort.target_c and self._orders.has_written(setpoint)
        return written and readings.air is not None and abs(readings.air - setpoint) <= SAFE_BAND_K

    def _time_to_safe(self) -> float:
        """Return the time allowed to reach the safe temperature [s]."""
        limits, safe = self.profile.limits, self.profile.on_abort
        return (limits.air_max_c - limits.air_min_c) / safe.rate_c_per_min * 60.0 + safe.timeout_s

    # Orders to the chamber --------------------------------------------------------------------

    def _order_chamber(self, readings: Readings) -> list[Action]:
        """Write the set-point where it is due, then have the chamber run or stop."""
        mode, setpoint = self.progress.mode, self.progress.setpoint
        if mode not in (RUN, PAUSED, SAFE):
            return []
        if self.progress.stage in (CONFIRM, STOP):
            return self._orders.keep_stopped(self._now, readings)
        actions: list[Action] = []
        if setpoint is not None:
            actions += self._orders.write_setpoint(self._now, setpoint, self._ramp())
        if mode != SAFE:
            actions += self._orders.keep_running(self._now, readings)
        return actions

    def _ramp(self) -> Ramp:
        """Return target and rate of the programmed temperature now."""
        if self.progress.mode == SAFE:
            return Ramp(self.profile.on_abort.target_c, self.profile.on_abort.rate_c_per_min)
        in_move = self.progress.mode == RUN and self.progress.stage == MOVE
        moving = in_move and self._orders.started
        return Ramp(self.step.target_c, self.step.rate_c_per_min if moving else 0.0)

    def _advance(self, elapsed: float) -> float | None:
        """Advance the programmed temperature along its ramp and return it [°C]."""
        if self.progress.setpoint is not None:
            setpoint = advanced(self.progress.setpoint, self._ramp(), elapsed)
            self.progress = replace(self.progress, setpoint=setpoint)
        return self.progress.setpoint

    def _start_from_air(self, readings: Readings) -> None:
        """Begin the programmed temperature at the air's, so that it does not jump."""
        if readings.air is not None:
            limits = self.profile.limits
            setpoint = min(max(readings.air, limits.air_min_c), limits.air_max_c)
            self.progress = replace(self.progress, setpoint=setpoint)
        self._orders.begin(self._now)

    # Progress: every change of mode, step or stage is a note ------------------------------------

    def _next_step(self) -> list[Action]:
        if self.progress.step + 1 < len(self.steps):
            return self._enter('step', self.progress.step + 1)
        return self._enter_stage(STOP)

    def _enter(self, event: str, number: int, mode: str = '') -> list[Action]:
        step = self.steps[number]
        self._timer = StepTimer(step, self.progress.setpoint, self._now)
        at_target = self.progress.setpoint == step.target_c and self._orders.started
        stage = SETTLE if at_target and step.kind != 'ramp' else MOVE
        mode = mode or self.progress.mode
        return self._note(event, mode=mode, step=number, stage=stage, reason='')

    def _enter_stage(self, stage: str, **details: Any) -> list[Action]:
        self._timer.enter_stage(self._now)
        return self._note('stage', stage=stage, **details)

    def _end(self, reason: str) -> list[Action]:
        return self._note('aborted', mode=ABORTED, stage=STOP, reason=reason)

    def _note(self, event: str, **changes: Any) -> list[Action]:
        """Change the progress and note it; what in `changes` is no progress are details."""
        names = ('mode', 'step', 'stage', 'reason', 'aborting')
        own = {name: value for name, value in changes.items() if name in names}
        self.progress = replace(self.progress, **own)
        details = {name: value for name, value in changes.items() if name not in names}
        return [Note(event, self.progress, details)]
