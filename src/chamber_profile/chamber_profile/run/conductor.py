# SPDX-License-Identifier: Apache-2.0
"""Conducts a run: readings into the sequencer, notes into the journal, orders to the chamber."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from imu_recording.free_space import free_bytes

from chamber_profile.chambers.chamber import ChamberReading
from chamber_profile.profile.values import Step
from chamber_profile.run.chamber_link import ChamberLink, readings_of
from chamber_profile.run.journal import Journal
from chamber_profile.run.sequencer import Sequencer
from chamber_profile.run.values import (
    FINISHED,
    LINK_FAILING,
    LINK_OK,
    Note,
    Progress,
    Readings,
)


@dataclass(frozen=True)
class Clocks:
    """The three clocks of a run."""

    host: Callable[[], float]
    """Monotonic time for retries and time-outs of the link [s]."""
    chamber: Callable[[], float]
    """Time of the profile: host time × time scale [s]."""
    stamp: Callable[[], int]
    """ROS time [ns]."""


@dataclass(frozen=True)
class ExternalReadings:
    """Readings that come from elsewhere than the chamber."""

    imu_alive: bool = True
    fault: str = ''
    """Fault of recorder or reference logger; '' none."""
    air: float | None = None
    """Air of the reference logger [°C]; replaces the chamber's where `referenced`."""
    device: float | None = None
    """Thermocouple of the reference logger [°C]."""
    referenced: bool = False
    """Whether a reference logger replaces the chamber's own sensors."""


@dataclass(frozen=True)
class RunSnapshot:
    """State of a run after one step, for topics and diagnostics."""

    stamp: int
    """ROS time of the reading [ns]."""
    reading: ChamberReading | None
    """None while the chamber does not answer."""
    progress: Progress
    step: Step
    prompt: str
    dwelt_s: float
    publish_due: bool
    """Whether the chamber's readings are to be published and recorded now."""
    fault: str
    """Fault of link or journal; '' none."""


class Conductor:
    """Advances a run by `step`, about twice a second; the caller provides the clocks."""

    def __init__(
        self,
        sequencer: Sequencer,
        link: ChamberLink,
        directory: Path,
        clocks: Clocks,
        external: Callable[[], ExternalReadings],
    ) -> None:
        self.sequencer = sequencer
        self.link = link
        self.directory = directory
        self.report: Callable[[str], object] = lambda _: None
        """Is called with a line for every note."""
        self._clocks = clocks
        self._external = external
        self._journal: Journal | None = None
        self._journal_fault = ''
        self._simulated_until: float | None = None
        self._published_at = float('-inf')
        self._now = 0.0

    @property
    def over(self) -> bool:
        """Whether the run has ended."""
        return self.sequencer.progress.mode in FINISHED

    def step(self) -> RunSnapshot:
        """Read the chamber, decide, note, order; return the state after it."""
        self._advance_simulation(self._clocks.chamber())
        reading = self.link.read()
        now, stamp = self._clocks.chamber(), self._clocks.stamp()  # time of the reading
        self._now = round(now, 3)
        if reading is not None:
            chamber = self.link.chamber
            self.sequencer.set_capabilities(
                resolution_c=chamber.resolution_c, programs_limits=chamber.programs_limits
            )
        actions = self.sequencer.tick(self._readings(now, reading))
        self.link.carry_out(actions, self._note)
        return RunSnapshot(
            stamp=stamp,
            reading=reading,
            progress=self.sequencer.progress,
            step=self.sequencer.step,
            prompt=self.sequencer.prompt,
            dwelt_s=self.sequencer.dwelt_s,
            publish_due=reading is not None and self._publish_due(now),
            fault=self.link.fault or self._journal_fault,
        )

    def stop_at_once(self) -> None:
        """Put the chamber on stand-by now, without a ramp, and note it."""
        if self.sequencer.command('standby') == '':
            self._now = self._clocks.chamber()
            unread = Readings(time=self._now, link=LINK_FAILING)
            self.link.carry_out(self.sequencer.tick(unread), self._note)

    def close(self) -> None:
        """Release line and journal; the chamber goes on as it is."""
        self.link.close()
        if self._journal is not None:
            self._journal.close()
            self._journal = None

    def _readings(self, now: float, reading: ChamberReading | None) -> Readings:
        external = self._external()
        readings = Readings(time=now, link=self.link.status)
        if reading is not None and self.link.status == LINK_OK:
            readings = readings_of(now, reading)
            if external.referenced:
                readings = replace(readings, air=external.air, device=external.device)
            elif external.device is not None:
                readings = replace(readings, device=external.device)
        return replace(
            readings,
            imu_alive=external.imu_alive,
            disk_free=float(free_bytes(self.directory)),
            fault=self._journal_fault or external.fault,
        )

    def _note(self, note: Note) -> None:
        """Write to the journal; where that fails, the run goes to the safe state."""
        stamp = self._clocks.stamp()
        step = self.sequencer.steps[note.progress.step]
        facts = {'id': step.id, 'phase': step.phase, 'cycle': step.cycle, 'clock_s': self._now}
        try:
            if self._journal is None:
                self._journal = Journal(self.directory)
                self._journal.begin(self.sequencer.profile, stamp, chamber=self.link.identity)
            self._journal.write(note, stamp, orientation=step.orientation, **facts)
        except OSError as error:
            self._journal_fault = f'the journal cannot be written: {error.strerror or error}'
        why = note.progress.reason or note.details.get('prompt', note.details.get('warning', ''))
        self.report(
            f'{note.event}: {note.progress.mode} {step.id} {note.progress.stage}'
            + (f', {why}' if why else '')
        )

    def _publish_due(self, now: float) -> bool:
        period = self.sequencer.profile.record.chamber_period_s
        if now - self._published_at < 0.95 * period:
            return False
        self._published_at = now
        return True

    def _advance_simulation(self, now: float) -> None:
        """Advance a chamber that is simulated in this process: it has no clock of its own."""
        advance = getattr(self.link.chamber, 'advance', None)
        if advance is not None:
            before, self._simulated_until = self._simulated_until, now
            if before is not None and now > before:
                advance(now - before)
