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
from chamber_profile.run.values import FINISHED, LINK_FAILING, LINK_OK, Note, Progress, Readings


@dataclass(frozen=True)
class Clocks:
    """The three clocks of a run."""

    host: Callable[[], float]
    """Monotonic [s]: retries and time-outs of the link."""
    chamber: Callable[[], float]
    """[s] of the profile; host time × time scale."""
    stamp: Callable[[], int]
    """ROS time [ns]."""


@dataclass(frozen=True)
class Surroundings:
    """What the chamber itself does not know."""

    imu_alive: bool = True
    fault: str = ''
    air: float | None = None
    """Air of the reference logger [°C]; counts instead of the chamber's where `referenced`."""
    device: float | None = None
    """Thermocouple of the reference logger [°C]."""
    referenced: bool = False


@dataclass(frozen=True)
class Moment:
    """A run at one moment, for those who show it."""

    stamp: int
    """ROS time of the reading [ns]."""
    reading: ChamberReading | None
    """None while the chamber does not answer."""
    progress: Progress
    step: Step
    prompt: str
    dwelt_s: float
    due: bool
    """Whether it is time to publish and record the chamber's readings."""
    complaint: str
    """What the link or the journal complain of; '' nothing."""


class Conductor:
    """Advances a run by `step`, about twice a second; the caller provides clocks and IMU news."""

    def __init__(
        self,
        sequencer: Sequencer,
        link: ChamberLink,
        directory: Path,
        clocks: Clocks,
        surroundings: Callable[[], Surroundings],
    ) -> None:
        self.sequencer = sequencer
        self.link = link
        self.directory = directory
        self.report: Callable[[str], object] = lambda _: None
        """Told every change in one line."""
        self._clocks = clocks
        self._surroundings = surroundings
        self._journal: Journal | None = None
        self._journal_fault = ''
        self._simulated_at: float | None = None
        self._shown_at = float('-inf')
        self._now = 0.0

    @property
    def over(self) -> bool:
        """Whether the run has ended, one way or the other."""
        return self.sequencer.progress.mode in FINISHED

    def step(self) -> Moment:
        """Read, decide, note, order; return how things stand."""
        self._let_pass(self._clocks.chamber())
        reading = self.link.read()
        now, stamp = self._clocks.chamber(), self._clocks.stamp()  # when this was read
        self._now = round(now, 3)
        if reading is not None:
            chamber = self.link.chamber
            self.sequencer.suit(
                resolution_c=chamber.resolution_c, programs_limits=chamber.programs_limits
            )
        actions = self.sequencer.tick(self._readings(now, reading))
        self.link.carry_out(actions, self._note)
        return Moment(
            stamp=stamp,
            reading=reading,
            progress=self.sequencer.progress,
            step=self.sequencer.step,
            prompt=self.sequencer.prompt,
            dwelt_s=self.sequencer.dwelt_s,
            due=reading is not None and self._is_due(now),
            complaint=self.link.complaint or self._journal_fault,
        )

    def close(self) -> None:
        """Release line and journal; the chamber goes on as it is."""
        self.link.close()
        if self._journal is not None:
            self._journal.close()
            self._journal = None

    def _readings(self, now: float, reading: ChamberReading | None) -> Readings:
        around = self._surroundings()
        common = {
            'imu_alive': around.imu_alive,
            'disk_free': float(free_bytes(self.directory)),
            'fault': self._journal_fault or around.fault,
        }
        if reading is None or self.link.status != LINK_OK:
            status = self.link.status
            return Readings(time=now, link=status, **common)  # type: ignore[arg-type]
        readings = readings_of(now, reading)
        if around.referenced:
            readings = replace(readings, air=around.air, device=around.device)
        elif around.device is not None:
            readings = replace(readings, device=around.device)
        return replace(readings, **common)  # type: ignore[arg-type]

    def _note(self, note: Note) -> None:
        """Write to the journal; one that cannot be written ends the run, but safely."""
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

    def stop_at_once(self) -> None:
        """Put the chamber on stand-by now, without a ramp, and note it."""
        if self.sequencer.command('standby') == '':
            self._now = self._clocks.chamber()
            lost = Readings(time=self._now, link=LINK_FAILING)
            self.link.carry_out(self.sequencer.tick(lost), self._note)

    def _is_due(self, now: float) -> bool:
        period = self.sequencer.profile.record.chamber_period_s
        if now - self._shown_at < 0.95 * period:
            return False
        self._shown_at = now
        return True

    def _let_pass(self, now: float) -> None:
        """A chamber simulated in this process has no clock of its own."""
        advance = getattr(self.link.chamber, 'advance', None)
        if advance is not None:
            before, self._simulated_at = self._simulated_at, now
            if before is not None and now > before:
                advance(now - before)
