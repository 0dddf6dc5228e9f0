# SPDX-License-Identifier: Apache-2.0
"""A harness for the sequencer, the plainest chamber there can be; emulators on a wire."""

from __future__ import annotations

import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest
from chamber_profile.chambers.catalogue import open_chamber
from chamber_profile.emulators.chamber import SERVERS
from chamber_profile.emulators.endpoint import PtyEndpoint, TcpEndpoint
from chamber_profile.emulators.faults import FaultPlan, parse_fault
from chamber_profile.emulators.plant import EmulatedPlant
from chamber_profile.profile.file import load_profile, profile_from_content
from chamber_profile.run.sequencer import Sequencer
from chamber_profile.run.values import (
    FINISHED,
    LINK_OK,
    RUN,
    Note,
    ProgramLimits,
    Readings,
    Switch,
    WriteSetpoint,
)

sys.path.insert(0, str(Path(__file__).parent))  # modules the tests of this folder share


class SequencerHarness:
    """Air follows the set-point with a lag while the chamber runs; every order is logged."""

    def __init__(self, profile, *, progress=None, air: float = 23.0, lag_s: float = 30.0) -> None:
        self.sequencer = Sequencer(profile, progress=progress)
        self.profile = profile
        self.time = 0.0
        self.air, self.device, self.lag_s = air, air, lag_s
        self.setpoint = air
        self.running = False
        self.limits: tuple[float, float] | None = None
        self.world: dict = {}
        """Readings that differ from those of a chamber in order."""
        self.obeys = True
        self.notes: list[Note] = []
        self.writes: list[tuple[float, float]] = []
        self.log: list[tuple[float, object]] = []

    @property
    def mode(self) -> str:
        return self.sequencer.progress.mode

    @property
    def events(self) -> list[str]:
        return [note.event for note in self.notes]

    def readings(self) -> Readings:
        here = Readings(
            time=self.time,
            air=self.air,
            device=self.device,
            setpoint=self.setpoint,
            running=self.running,
        )
        if self.world.get('link', LINK_OK) != LINK_OK:
            here = Readings(time=self.time)
        return replace(here, **self.world)

    def tick(self, seconds: float = 1.0) -> list:
        self.time += seconds
        share = min(seconds / self.lag_s, 1.0)
        goal = self.setpoint if self.running else 23.0
        self.air += share * (goal - self.air)
        self.device += min(seconds / 300.0, 1.0) * (self.air - self.device)
        actions = self.sequencer.tick(self.readings())
        for action in actions:
            self.log.append((self.time, action))
            self.carry_out(action)
        return actions

    def carry_out(self, action) -> None:
        reached = self.obeys and self.world.get('link', LINK_OK) == LINK_OK
        if isinstance(action, Note):
            self.notes.append(action)
        elif isinstance(action, WriteSetpoint):
            self.writes.append((self.time, action.temperature_c))
            self.setpoint = action.temperature_c if reached else self.setpoint
        elif isinstance(action, Switch):
            self.running = action.on if reached else self.running
        elif isinstance(action, ProgramLimits) and reached:
            self.limits = (action.low_c, action.high_c)

    def run_until(self, condition, *, longest_s: float = 100_000.0, tick_s: float = 1.0) -> None:
        """Tick until the condition holds; fail when it never does."""
        end = self.time + longest_s
        while not condition():
            assert self.time < end, (self.sequencer.progress, self.sequencer.step.id)
            self.tick(tick_s)

    def to_step(self, name: str, stage: str = '') -> None:
        """Run until a step, or a stage of it, is reached."""
        sequencer = self.sequencer
        self.run_until(
            lambda: (
                sequencer.progress.mode == RUN
                and sequencer.step.id == name
                and (not stage or sequencer.progress.stage == stage)
            )
        )

    def start(self) -> None:
        assert self.sequencer.command('start') == ''
        self.tick()

    def run_to_the_end(self) -> None:
        self.run_until(lambda: self.mode in FINISHED)


@pytest.fixture
def harness():
    """Make a harness for a profile (name, content or Profile), started and run to a place `at`."""

    def make(profile='short_20min', *, at: tuple[str, ...] = (), **options) -> SequencerHarness:
        if isinstance(profile, str):
            profile = load_profile(profile)
        elif isinstance(profile, dict):
            profile = profile_from_content(profile)
        made = SequencerHarness(profile, **options)
        if at:
            made.start()
            made.to_step(*at)
        return made

    return make


@pytest.fixture
def emulator(tmp_path: Path):
    """Serve a protocol in a thread; its clock is `clock[0]`, set by hand."""
    running = []

    def start(protocol: str, wire: str, *faults: str, options: str = ''):
        body = EmulatedPlant(seed=1)
        plan = FaultPlan([parse_fault(text) for text in faults], body)
        clock = [0.0]

        def make_server():
            return SERVERS[protocol](body, 0, wire == 'tcp')

        if wire == 'tcp':
            endpoint = TcpEndpoint(0, make_server)
            address = f'{protocol}+{endpoint.name}'
        else:
            endpoint = PtyEndpoint(tmp_path / 'chamber', make_server)
            address = f'{protocol}+{endpoint.name}'
        stop = threading.Event()

        def serve() -> None:
            def prepare():
                body.advance_to(clock[0])
                return plan.active_at(clock[0])

            while not stop.is_set():
                endpoint.serve(0.01, prepare)
            endpoint.close()

        thread = threading.Thread(target=serve)
        thread.start()
        running.append((stop, thread))
        chamber = open_chamber(address + options)
        return chamber, body, clock

    yield start
    for stop, thread in running:
        stop.set()
        thread.join()


@pytest.fixture
def laboratory(tmp_path):
    """Make laboratories; whatever still runs at the end is killed."""
    from laboratory import Laboratory

    made = []

    def make(**options):
        made.append(Laboratory(tmp_path, **options))
        return made[-1]

    yield make
    for laboratory in made:
        laboratory.close()
