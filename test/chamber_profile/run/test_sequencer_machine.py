# SPDX-License-Identifier: Apache-2.0
"""Random faults, operators, clocks, kills: never out of limits, never too fast, always safe."""

import json
from dataclasses import asdict, replace

import hypothesis.strategies as st
from chamber_profile.profile.file import load_profile
from chamber_profile.run.sequencer import COMMANDS, Sequencer
from chamber_profile.run.values import (
    ABORTED,
    DONE,
    DWELL,
    FINISHED,
    IDLE,
    SAFE,
    Note,
    Progress,
    Readings,
    Switch,
    WriteSetpoint,
)
from edge_profile import EDGE
from hypothesis import settings
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    precondition,
    rule,
)
from sequence_watch import Watch

PROFILES = {n: load_profile(n) for n in ('short_20min', 'improved_campaign', 'jesd22_a104')}
PROFILES['edge'] = EDGE


def under_way(machine) -> bool:
    return machine.sequencer.progress.mode not in (SAFE, *FINISHED)


class Runs(RuleBasedStateMachine):
    """A sequencer, a chamber that may or may not obey, and an environment full of faults."""

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
        self.resolution = 0.5 if further % 4 == 0 else 0.1
        self.sequencer = Sequencer(self.profile, self.resolution)
        self.watch = Watch(self.profile, self.resolution)
        self.ordered = ''
        self.order('start')
        self.time, self.air, self.device = 0.0, air, air
        self.setpoint, self.running = air, False
        self.link, self.obeys = 'ok', True
        self.world: dict = {}
        self.journal: list[Progress] = []
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
                self.order(name)
        goal = self.sequencer.progress.step + steps
        for _ in range(1250):
            self.tick(12.0)
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
            {'air': 18.0, 'device': 18.0}, {'air': 27.0, 'device': 27.0},
        ]),
        ticks=st.integers(1, 100),
        heals=st.booleans(),
        killed=st.booleans(),
    )  # fmt: skip
    def a_fault(self, world, ticks, heals, killed) -> None:
        self.world = world
        for _ in range(ticks):
            self.tick(1.0)
        if killed and self.journal and self.sequencer.progress.mode not in FINISHED:
            self.a_kill_and_a_restart(at_once=True)
        self.world = {} if heals else world

    @precondition(lambda self: self.sequencer.progress.stage == DWELL and under_way(self))
    @rule(apart=st.sampled_from([-6.0, 6.0]), ticks=st.integers(1, 20))
    def the_air_leaves_the_band(self, apart, ticks) -> None:
        limits = self.profile.limits
        here = self.sequencer.step.target_c + apart
        here = min(max(here, limits.air_min_c), limits.air_max_c)
        for world in ({'air': here, 'device': here}, {}):
            self.link, self.world = 'ok', world
            for _ in range(ticks):
                self.tick(5.0)

    @precondition(lambda self: self.sequencer.progress.mode == SAFE)
    @rule()
    def the_safe_temperature_is_never_reached(self) -> None:
        self.link, self.obeys, self.world = 'ok', True, {'air': 28.0, 'device': 28.0}
        while self.sequencer.progress.mode == SAFE:
            self.tick(9.0)

    @precondition(under_way)
    @rule(
        names=st.lists(
            st.sampled_from(['pause', 'breaks', 'heals', 'resume']), min_size=2, max_size=6
        ),
        ticks=st.integers(1, 60),
    )
    def pauses_and_a_link_that_comes_and_goes(self, names, ticks) -> None:
        for name in names:
            if name in ('pause', 'resume'):
                self.order(name)
            else:
                self.link = 'failing' if name == 'breaks' else 'ok'
            for _ in range(ticks):
                self.tick(1.0)
        self.link = 'ok'

    @precondition(under_way)
    @rule(name=st.sampled_from([*COMMANDS, 'confirm', 'pause', 'resume', 'standby']))
    def an_operator(self, name) -> None:
        self.order(name)
        self.tick(1.0)

    @precondition(lambda self: self.sequencer.progress.mode not in FINISHED and self.journal)
    @rule(at_once=st.booleans())
    def a_kill_and_a_restart(self, at_once) -> None:
        kept = Progress(**json.loads(json.dumps(asdict(self.journal[-1]))))
        self.journal.append(replace(kept, mode=IDLE))
        self.sequencer = Sequencer(self.profile, self.resolution, self.journal[-1])
        self.watch.restarted()
        self.ordered = ''
        if at_once:
            self.order('start')
            for _ in range(20):
                self.tick(1.0)

    # One tick ------------------------------------------------------------------------------

    def tick(self, seconds: float) -> None:
        self.time += seconds
        goal = self.setpoint if self.running else 23.0
        share = min(max(seconds, 0.0), 60.0) / 60.0
        self.air += share * (goal - self.air)
        self.device += share / 5.0 * (self.air - self.device)
        readings = Readings(
            time=self.time, link=self.link, air=self.air, device=self.device,
            setpoint=self.setpoint, running=self.running,
        )  # fmt: skip
        if self.link != 'ok':
            readings = Readings(time=self.time, link=self.link)
        if self.world:
            readings = replace(readings, **self.world)
        before, command = self.sequencer.progress, self.ordered
        actions = self.sequencer.tick(readings)
        self.ordered = ''
        after = self.sequencer.progress
        self.watch.look(before, readings, actions, after, command)
        for action in actions:
            if isinstance(action, Note):
                self.journal.append(action.progress)
            else:
                self.carry_out(action)

    def carry_out(self, action) -> None:
        if self.link != 'ok' or not self.obeys:
            return
        if isinstance(action, WriteSetpoint):
            self.setpoint = action.temperature_c
        elif isinstance(action, Switch):
            self.running = action.on

    def order(self, name: str) -> None:
        refused = self.sequencer.command(name)
        assert bool(refused) == bool(self.sequencer.refusal(name))
        if not refused:
            self.ordered = name

    def teardown(self) -> None:
        """However it went: left alone with a chamber in order, the run ends with it off."""
        if hasattr(self, 'sequencer'):
            self.left_alone()

    def left_alone(self) -> None:
        self.link, self.obeys, self.world = 'ok', True, {}
        if self.sequencer.under_way:
            self.order('abort')
            for count in range(20_000):
                self.tick(1.0 if count < 60 else 5.0)
                if not self.sequencer.under_way:
                    break
        progress = self.sequencer.progress
        assert progress.mode in (IDLE, *FINISHED), progress
        if progress.mode in (DONE, ABORTED):
            excused = 'did not confirm' in progress.reason or 'at once' in progress.reason
            assert not self.running or excused or self.never_ours()

    def never_ours(self) -> bool:
        """A chamber we never started is not ours to stop."""
        return not self.watch.ours


Runs.TestCase.settings = settings(
    max_examples=8, stateful_step_count=30, deadline=None, derandomize=True
)
TestRuns = Runs.TestCase
