# SPDX-License-Identifier: Apache-2.0
"""What a sequencer owes the chamber, worked out again from what it sees and what it does.

The watch knows the profile, the readings and the actions, and nothing of the sequencer's own
arithmetic: it keeps its own clocks.
"""

from __future__ import annotations

from dataclasses import dataclass

from chamber_profile.profile.values import Step
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
    MOVE,
    PAUSED,
    RUN,
    SAFE,
    SETTLE,
    STOP,
    Note,
    Progress,
    Readings,
)
from order_watch import OrderWatch

LONGEST_S = 10.0
GAP_S = 4.98
NEAR_C = 2.0


@dataclass
class Watch(OrderWatch):
    """Give it every tick; it fails at the first that breaks a promise."""

    clock: float = 0.0
    """On the dwell's clock [s]."""
    inside: float | None = None
    """Since when the watched temperature is in the band of the step [s]."""
    entered: float = 0.0
    """When the present stage began [s]."""
    held: str = RUN
    """The mode that HOLD_FAULT interrupts."""

    # One tick ------------------------------------------------------------------------------

    def look(
        self, before: Progress, readings: Readings, actions: list, after: Progress, command: str
    ) -> None:
        elapsed = min(max(readings.time - self.time, 0.0), LONGEST_S)
        known = self.time > float('-inf') and before.mode == after.mode
        elapsed = elapsed if known else 0.0
        self.time = max(self.time, readings.time)
        events = [action.event for action in actions if isinstance(action, Note)]
        self._order(before, actions, after)
        self._mode(before, readings, after, events, command)
        self._programmed(before, readings, after, elapsed, events)
        self._stages(before, readings, after, elapsed, events)
        self.look_at_orders(before, readings, actions, after)

    def _order(self, before: Progress, actions: list, after: Progress) -> None:
        """The journal knows of every change before anything is done about it."""
        kinds = [isinstance(action, Note) for action in actions]
        assert kinds == sorted(kinds, reverse=True), f'done before it was noted: {actions}'
        place = (after.mode, after.step, after.stage, after.reason)
        if place != (before.mode, before.step, before.stage, before.reason):
            assert kinds, 'a change that was not noted'
            assert kinds[0]
        if any(kinds):
            last = [action for action in actions if isinstance(action, Note)][-1].progress
            assert (last.mode, last.step, last.stage, last.reason) == place

    # Modes ---------------------------------------------------------------------------------

    def fault_present(self, progress: Progress, readings: Readings) -> bool:
        """What must end a run that is under way, at once."""
        if readings.link != 'ok':
            return readings.link == 'lost'
        limits, waiting = self.profile.limits, progress.stage in (CONFIRM, STOP)
        air, device = readings.air, readings.device
        return (
            bool(readings.alarms)
            or bool(readings.fault)
            or readings.disk_free < 1 << 30
            or (not readings.imu_alive and not waiting)
            or (air is not None and not limits.air_min_c - 1 <= air <= limits.air_max_c + 1)
            or (device is not None and not limits.device_min_c <= device <= limits.device_max_c)
            or (self.confirmed and readings.running is False and not waiting)
        )

    def _mode(
        self, before: Progress, readings: Readings, after: Progress, events: list, command: str
    ) -> None:
        was, now = before.mode, after.mode
        if was in FINISHED:
            assert after == before
        elif was == SAFE:
            assert now in (SAFE, ABORTED)
        elif was in (IDLE, CHECK):
            self._before_the_run(before, readings, after, command)
        elif was in CONTROLLING:
            self._in_charge(before, readings, after, events, command)
        if now in FINISHED and before.stage == STOP and was in (RUN, SAFE):
            assert readings.running is False or 'did not confirm' in after.reason
        if now == DONE != was:
            assert abs(after.setpoint - self.profile.on_abort.target_c) <= NEAR_C
            assert (was, before.stage, before.step) == (RUN, STOP, len(self.steps) - 1)
        if now == RUN and after.step != before.step:
            assert after.step == before.step + 1
        if now == ABORTED and was in (*CONTROLLING, SAFE):
            assert before.stage == STOP or command == 'standby' or 'safe' in events

    def _before_the_run(
        self, before: Progress, readings: Readings, after: Progress, command: str
    ) -> None:
        was, now = before.mode, after.mode
        if was == IDLE and command == 'start':
            assert now == (SAFE if before.aborting else CHECK) or after.reason
        elif was == IDLE:
            assert command or now == IDLE
            assert now in (IDLE, SAFE, ABORTED)
        elif now == RUN:
            assert readings.link == 'ok'
            assert self.limited
            assert not self.fault_present(before, readings), 'started although something is wrong'

    def _in_charge(
        self, before: Progress, readings: Readings, after: Progress, events: list, command: str
    ) -> None:
        was, now = before.mode, after.mode
        if command == 'standby':
            assert now == ABORTED
        elif command == 'abort' or self.fault_present(before, readings):
            assert now in (SAFE, ABORTED), (readings, after)
            assert 'safe' in events
        elif readings.link == 'failing':
            assert now == HOLD_FAULT
            assert was != HOLD_FAULT or after == before
            self.held = self.held if was == HOLD_FAULT else was
            self.held = {'pause': PAUSED, 'resume': RUN}.get(command, self.held)
        elif command == 'pause' or (was == HOLD_FAULT and self.held == PAUSED):
            assert now in (PAUSED, SAFE)
        elif was == PAUSED and command == '':
            assert now == SAFE or after == before

    # The programmed temperature ------------------------------------------------------------

    def _programmed(
        self, before: Progress, readings: Readings, after: Progress, elapsed: float, events: list
    ) -> None:
        limits = self.profile.limits
        here = after.setpoint
        if here is None:
            assert after.mode not in (RUN, PAUSED)
            return
        assert limits.air_min_c <= here <= limits.air_max_c
        to_safety = before.mode in (IDLE, CHECK) and after.mode == SAFE
        if to_safety or {'run', 'interrupted', 'confirm'} & set(events):
            self.told = self.confirmed = False
            start = before.setpoint if readings.air is None else readings.air
            start = min(max(start, limits.air_min_c), limits.air_max_c)
            _, rate = self.heading(after)
            assert abs(here - start) <= rate / 60.0 * elapsed + 1e-6, 'jumps when it takes over'
            return
        moved = here - before.setpoint
        moving = before.mode == RUN == after.mode and before.stage == MOVE and self.confirmed
        if (after.mode == SAFE and after.stage == MOVE) or moving:
            target, rate = self.heading(before if moving else after)
            self._moves(before.setpoint, moved, target, rate, elapsed)
        else:
            begun = before.mode == SAFE == after.mode and before.stage == MOVE
            _, rate = self.heading(after) if begun else (0.0, 0.0)
            assert abs(moved) <= rate / 60.0 * elapsed + 1e-6, 'moves while it is held'

    def _moves(
        self, start: float, moved: float, target: float, rate: float, elapsed: float
    ) -> None:
        """At the rate of the step, no slower and no faster, and it stops at the target."""
        way = target - start
        expected = min(abs(way), rate / 60.0 * elapsed) * (1.0 if way > 0 else -1.0)
        assert abs(moved - expected) < 1e-6, (start, moved, target, rate, elapsed)

    # Stages --------------------------------------------------------------------------------

    def _stages(
        self, before: Progress, readings: Readings, after: Progress, elapsed: float, events: list
    ) -> None:
        step = self.steps[before.step]
        if before.mode in (PAUSED, HOLD_FAULT) and after.mode == RUN:
            self.inside = None
            self.entered = self.time if before.stage == SETTLE else self.entered
        if before.mode in CONTROLLING and (after.mode, readings.link) == (RUN, 'ok'):
            self._ran(before, readings, after, step, elapsed)
        if after.stage == CONFIRM != before.stage:
            self._may_be_opened(readings, step)
        if (before.mode, before.stage, after.mode) == (RUN, CONFIRM, RUN):
            assert ('confirm' in events) == (after.stage != CONFIRM), 'only the operator goes on'
        if after.step != before.step and step.kind == 'operator':
            assert 'confirm' in events, 'the operator was not asked'
        if 'interrupted' in events or 'run' in events:
            assert after.stage in (MOVE, SETTLE)
            assert after.interruptions - before.interruptions == int('interrupted' in events)
        if before.mode == SAFE and after.stage == STOP != before.stage:
            self._may_be_stopped(readings, after)
        if before.mode == SAFE and after.stage == MOVE:
            assert self.time - self.entered <= self._longest(), 'never gives up'
        if (before.mode, before.step, before.stage) != (after.mode, after.step, after.stage):
            self._entered(before, after)

    def _ran(
        self, before: Progress, readings: Readings, after: Progress, step: Step, elapsed: float
    ) -> None:
        """Settling and dwelling, on clocks of our own."""
        rule = step.stabilise
        if rule is None:
            return
        value = readings.air if rule.source == 'air' else readings.device
        near = value is not None and abs(value - step.target_c) <= rule.band_c
        if before.stage == SETTLE:
            since = self.time if self.inside is None else self.inside
            self.inside = since if near else None
            held = near and self.time - since >= rule.hold_s - 1e-6
            late = rule.on_timeout == 'continue' and self.time - self.entered >= rule.timeout_s
            assert after.stage != DWELL or held or late, 'dwells before it has settled'
            waited = self.time - elapsed - self.entered
            assert after.stage == DWELL or waited <= rule.timeout_s, 'waits for ever'
        elif before.stage == DWELL:
            if step.dwell_mode == 'free' or near:
                self.clock += elapsed
            elif step.dwell_mode == 'restart':
                self.clock = 0.0
            over = (after.step, after.stage) != (before.step, before.stage)
            assert over == (self.clock >= step.dwell_s - 1e-6), (self.clock, step, after)

    def _entered(self, before: Progress, after: Progress) -> None:
        kept = (before.step, before.stage) == (after.step, after.stage)
        if not kept or after.mode == SAFE != before.mode:
            self.entered, self.clock, self.inside = self.time, 0.0, None

    def _may_be_opened(self, readings: Readings, step: Step) -> None:
        floor = self.profile.ambient_c - 1.0
        assert readings.air is not None
        assert readings.air >= floor
        assert readings.device is None or readings.device >= floor
        assert abs(readings.air - step.target_c) <= NEAR_C

    def _may_be_stopped(self, readings: Readings, after: Progress) -> None:
        """In the safe state: at the safe temperature, or stopped by others, or after long."""
        safe = self.profile.on_abort
        if readings.running is False or after.setpoint is None:
            return
        if self.time - self.entered > self._longest():
            return
        assert after.setpoint == safe.target_c
        assert readings.air is not None
        assert abs(readings.air - safe.target_c) <= NEAR_C, 'stopped before it was safe'

    def _longest(self) -> float:
        """How long the way to the safe temperature may take [s]."""
        safe, limits = self.profile.on_abort, self.profile.limits
        span = limits.air_max_c - limits.air_min_c
        return span / safe.rate_c_per_min * 60.0 + safe.timeout_s
