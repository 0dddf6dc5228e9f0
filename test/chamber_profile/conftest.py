# SPDX-License-Identifier: Apache-2.0
"""A bench for the sequencer: the plainest chamber there can be, and a clock by hand."""

from __future__ import annotations

from dataclasses import replace

import pytest
from chamber_profile.profile import load_profile, profile_from_content
from chamber_profile.sequence_types import (
    FINISHED,
    LINK_OK,
    Note,
    ProgramLimits,
    Readings,
    Switch,
    WriteSetpoint,
)
from chamber_profile.sequencer import Sequencer


class Bench:
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

    def start(self) -> None:
        assert self.sequencer.command('start') == ''
        self.tick()

    def run_to_the_end(self) -> None:
        self.run_until(lambda: self.mode in FINISHED)


@pytest.fixture
def bench():
    """Make a bench for a profile (name, content or Profile)."""

    def make(profile='short_20min', **options) -> Bench:
        if isinstance(profile, str):
            profile = load_profile(profile)
        elif isinstance(profile, dict):
            profile = profile_from_content(profile)
        return Bench(profile, **options)

    return make
