# SPDX-License-Identifier: Apache-2.0
"""Random faults, operators, clocks, kills: never out of limits, never too fast, always safe."""

import json
from dataclasses import asdict, replace

import hypothesis.strategies as st
from chamber_profile.profile import load_profile
from chamber_profile.sequence_types import (
    ABORTED,
    DONE,
    FINISHED,
    IDLE,
    IN_CHARGE,
    PAUSED,
    RUN,
    SAFE,
    Note,
    Progress,
    Readings,
    Switch,
    WriteSetpoint,
)
from chamber_profile.sequencer import COMMANDS, Sequencer
from chamber_profile.setpoint_program import JITTER_S, WRITE_PERIOD_S
from hypothesis import settings
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
)

PROFILES = {n: load_profile(n) for n in ('short_20min', 'improved_campaign', 'jesd22_a104')}
RESOLUTION = 0.1


def under_way(machine) -> bool:
    return machine.sequencer.progress.mode not in (SAFE, *FINISHED)


class Runs(RuleBasedStateMachine):
    """A sequencer, a chamber that may or may not obey, and a world full of trouble."""

    @initialize(
        name=st.sampled_from(sorted(PROFILES)),
        air=st.floats(15.0, 30.0),
        steps=st.integers(0, 12),
        further=st.integers(0, 200),
    )
    def begin(self, name, air, steps, further) -> None:
        self.fresh(name, air, steps, further)

    @precondition(lambda self: not under_way(self))
    @rule(
        name=st.sampled_from(sorted(PROFILES)),
        air=st.floats(15.0, 30.0),
        steps=st.integers(1, 12),
        further=st.integers(0, 200),
    )
    def another_run(self, name, air, steps, further) -> None:
        self.left_alone()
        self.fresh(name, air, steps, further)

    def fresh(self, name, air, steps, further) -> None:
        self.profile = PROFILES[name]
        self.sequencer = Sequencer(self.profile, RESOLUTION)
        self.sequencer.command('start')
        self.time, self.air = 0.0, air
        self.setpoint, self.running = air, False
        self.link, self.obeys = 'ok', True
        self.world: dict = {}
        self.writes: list[tuple[float, float]] = []
        self.journal: list[Progress] = []
        self.restarted = True
        if steps:
            self.all_is_well_for_a_while(steps)
            for _ in range(further):
                self.tick(5.0)

    # The world -----------------------------------------------------------------------------

    @precondition(under_way)
    @rule(
        count=st.integers(1, 300),
        seconds=st.sampled_from([0.5, 1.0, 2.0, 5.0, 7.0]),
    )
    def time_passes(self, count, seconds) -> None:
        for _ in range(count):
            self.tick(seconds)

    @precondition(under_way)
    @rule(steps=st.integers(1, 6))
    def all_is_well_for_a_while(self, steps) -> None:
        self.link, self.obeys, self.world = 'ok', True, {}
        for name in ('start', 'resume', 'confirm'):
            if not self.sequencer.refusal(name):
                self.sequencer.command(name)
        goal = self.sequencer.progress.step + steps
        for _ in range(3000):
            self.tick(5.0)
            over = self.sequencer.progress.mode in FINISHED
            if over or self.sequencer.progress.step >= goal or self.sequencer.prompt:
                return

    @precondition(under_way)
    @rule(hours=st.floats(-2.0, 2.0))
    def the_clock_jumps(self, hours) -> None:
        self.tick(hours * 3600.0)

    @precondition(under_way)
    @rule(
        link=st.sampled_from(['failing', 'failing', 'lost']),
        ticks=st.integers(1, 30),
        heals=st.booleans(),
    )
    def the_link_breaks(self, link, ticks, heals) -> None:
        self.link = link
        for _ in range(ticks):
            self.tick(1.0)
        self.link = 'ok' if heals else link

    @precondition(under_way)
    @rule(ticks=st.integers(1, 100), obeys=st.booleans())
    def the_chamber_does_not_obey(self, ticks, obeys) -> None:
        self.obeys = False
        for _ in range(ticks):
            self.tick(1.0)
        self.obeys = obeys

    @precondition(under_way)
    @rule(ticks=st.integers(1, 10))
    def someone_presses_stop(self, ticks) -> None:
        self.running = False
        for _ in range(ticks):
            self.tick(1.0)

    @precondition(under_way)
    @rule(value=st.sampled_from([-70.0, 0.0, 23.0, 150.0]), ticks=st.integers(1, 100))
    def someone_turns_the_setpoint(self, value, ticks) -> None:
        self.setpoint = value
        for _ in range(ticks):
            self.tick(1.0)

    @precondition(under_way)
    @rule(
        world=st.sampled_from([
            {'alarms': ('3',)}, {'imu_alive': False}, {'disk_free': 1.0}, {'fault': 'recorder'},
            {'device': 200.0}, {'air': 200.0}, {'air': None},
        ]),
        ticks=st.integers(1, 100),
        heals=st.booleans(),
    )  # fmt: skip
    def trouble(self, world, ticks, heals) -> None:
        self.world = world
        for _ in range(ticks):
            self.tick(1.0)
        self.world = {} if heals else world

    @precondition(under_way)
    @rule(name=st.sampled_from([*COMMANDS, 'confirm', 'pause', 'resume', 'standby']))
    def an_operator(self, name) -> None:
        refused = self.sequencer.command(name)
        assert bool(refused) == bool(self.sequencer.refusal(name))
        self.tick(1.0)

    @precondition(lambda self: self.sequencer.progress.mode not in FINISHED and self.journal)
    @rule()
    def a_kill_and_a_restart(self) -> None:
        kept = Progress(**json.loads(json.dumps(asdict(self.journal[-1]))))
        self.journal.append(replace(kept, mode=IDLE))
        self.sequencer = Sequencer(self.profile, RESOLUTION, self.journal[-1])
        self.restarted = True

    # One tick ------------------------------------------------------------------------------

    def tick(self, seconds: float) -> None:
        self.time += seconds
        goal = self.setpoint if self.running else 23.0
        self.air += min(max(seconds, 0.0) / 60.0, 1.0) * (goal - self.air)
        readings = Readings(
            time=self.time, link=self.link, air=self.air, device=self.air,
            setpoint=self.setpoint, running=self.running,
        )  # fmt: skip
        if self.link != 'ok':
            readings = Readings(time=self.time, link=self.link)
        before = self.sequencer.progress
        actions = self.sequencer.tick(replace(readings, **self.world))
        after = self.sequencer.progress
        self.journal += [action.progress for action in actions if isinstance(action, Note)]
        changed = (before.mode, before.step, before.stage) != (
            after.mode, after.step, after.stage,
        )  # fmt: skip
        assert not changed or isinstance(actions[0], Note), 'a change that was not noted first'
        if self.journal:
            kept = self.journal[-1]
            assert (kept.mode, kept.step, kept.stage) == (after.mode, after.step, after.stage)
        self.check_trouble(before, after)
        for action in actions:
            self.carry_out(action, before)

    def check_trouble(self, before: Progress, after: Progress) -> None:
        """What is really wrong ends a run that is under way, at once."""
        wrong = self.link == 'lost' or (
            self.link == 'ok'
            and any(key in self.world for key in ('alarms', 'disk_free', 'fault', 'device'))
        )
        if before.mode in IN_CHARGE and wrong:
            assert after.mode in (SAFE, ABORTED), (self.world, self.link, after)
        if before.mode == SAFE:
            assert after.mode in (SAFE, ABORTED)
        if before.mode in FINISHED:
            assert after == before

    def carry_out(self, action, before: Progress) -> None:
        reached = self.link == 'ok' and self.obeys
        if isinstance(action, WriteSetpoint):
            self.check_write(action.temperature_c)
            self.setpoint = action.temperature_c if reached else self.setpoint
        elif isinstance(action, Switch):
            if action.on:
                assert self.sequencer.progress.mode in (RUN, PAUSED)
                assert self.link != 'lost'
                assert self.writes, 'started before it was told a set-point'
            self.running = action.on if reached else self.running

    def check_write(self, value: float) -> None:
        limits = self.profile.limits
        assert limits.air_min_c - 1e-9 <= value <= limits.air_max_c + 1e-9
        clock = self.sequencer._now
        if self.writes and not self.restarted:
            then, last = self.writes[-1]
            passed = clock - then
            assert passed >= WRITE_PERIOD_S - JITTER_S - 1e-9
            if not self.taken_over_since(then):
                fastest = max(limits.rate_max_c_per_min, self.profile.on_abort.rate_c_per_min)
                assert abs(value - last) <= fastest / 60.0 * passed + RESOLUTION + 1e-6
        self.restarted = False
        self.writes.append((clock, value))

    def taken_over_since(self, then: float) -> bool:
        """After a start or a prompt the set-point goes on from where the air is."""
        return self.sequencer._orders._wanted_at >= then

    # What always holds -----------------------------------------------------------------------

    @invariant()
    def the_programmed_temperature_keeps_to_the_limits(self) -> None:
        if hasattr(self, 'sequencer') and self.sequencer.progress.setpoint is not None:
            limits = self.profile.limits
            setpoint = self.sequencer.progress.setpoint
            assert limits.air_min_c <= setpoint <= limits.air_max_c

    def teardown(self) -> None:
        """However it went: left alone with a chamber in order, the run ends with it off."""
        if hasattr(self, 'sequencer'):
            self.left_alone()

    def left_alone(self) -> None:
        self.link, self.obeys, self.world = 'ok', True, {}
        if self.sequencer.in_charge:
            self.sequencer.command('abort')
            for _ in range(20_000):
                self.tick(1.0)
                if not self.sequencer.in_charge:
                    break
        progress = self.sequencer.progress
        assert progress.mode in (IDLE, *FINISHED), progress
        if progress.mode in (DONE, ABORTED):
            excused = 'did not confirm' in progress.reason or 'at once' in progress.reason
            assert not self.running or excused or self.never_ours()

    def never_ours(self) -> bool:
        """A chamber we never started is not ours to stop."""
        return not self.writes


Runs.TestCase.settings = settings(
    max_examples=40, stateful_step_count=30, deadline=None, derandomize=True
)
TestRuns = Runs.TestCase
