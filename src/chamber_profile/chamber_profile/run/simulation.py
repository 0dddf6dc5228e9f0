# SPDX-License-Identifier: Apache-2.0
"""A whole run on a simulated chamber as columns, without waiting."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from imu_recording.recording import PHASES, FloatArray, IntArray
from imu_recording.user_error import UserError

from chamber_profile.chambers.simulated import SimulatedChamber
from chamber_profile.profile.values import Profile, Step
from chamber_profile.run.chamber_link import carry_out, readings_of
from chamber_profile.run.sequencer import Sequencer
from chamber_profile.run.values import CONFIRM, DONE, FINISHED, IDLE, Note

TICK_S = 5
"""Period of the sequencer: that of set-point writes [s]."""


@dataclass(frozen=True, eq=False)
class ChamberRun:
    """A run of a simulated chamber as columns (n,), one row per period."""

    time: FloatArray
    """[s] since the start."""
    setpoint: FloatArray
    """Set-point of the chamber [°C]."""
    air: FloatArray
    """True air temperature at the devices, which no sensor shows [°C]."""
    temperature: FloatArray
    """First PT100 [°C]."""
    temperature_2: FloatArray
    """Second PT100 [°C]."""
    heater: FloatArray
    """Duty, 0 … 1."""
    compressor: FloatArray
    """0 or 1."""
    fan: FloatArray
    """0 or 1."""
    humidity: FloatArray
    """Relative, 0 … 1."""
    phase: IntArray
    """Index into imu_recording's PHASES; −1 in operator steps."""
    cycle: IntArray
    """1 … within the cycles, 0 outside."""


def simulate_chamber(profile: Profile, *, seed: int, period_s: float = 1.0) -> ChamberRun:
    """Return one run of the profile (one orientation) on a simulated chamber.

    The real sequencer drives the physics; an operator's prompts are confirmed after the time the
    profile expects. `period_s` is a whole number of seconds. Equal seeds give equal runs.
    """
    period = int(period_s)
    if period < 1 or period != period_s:
        raise UserError(f'period_s is {period_s:g}, expected a whole number of seconds')
    chamber = SimulatedChamber(seed=seed)
    sequencer = Sequencer(replace(profile, orientations=()), chamber.resolution_c)
    notes: list[Note] = []
    rows: list[tuple[float, ...]] = []
    sequencer.command('start')
    time, confirm_at = 0, math.inf
    while sequencer.progress.mode not in FINISHED:
        carry_out(sequencer.tick(readings_of(float(time), chamber.read())), chamber, notes.append)
        if sequencer.progress.stage != CONFIRM:
            confirm_at = math.inf
        elif math.isinf(confirm_at):
            confirm_at = time + sequencer.step.expected_s
        elif time >= confirm_at:
            sequencer.command('confirm')
        step = sequencer.step if sequencer.progress.mode != IDLE else None
        for second in range(time, time + TICK_S):
            if second % period == 0:
                rows.append(_row(second, chamber, step))
            chamber.advance(1.0)
        time += TICK_S
    if sequencer.progress.mode != DONE:
        raise UserError(f'the simulated chamber cannot run {profile.name}: {notes[-1].progress}')
    return _run(rows)


def _row(second: int, chamber: SimulatedChamber, step: Step | None) -> tuple[float, ...]:
    reading = chamber.read()
    known = step is not None and step.phase in PHASES
    return (
        float(second),
        chamber.setpoint,
        chamber.true_air,
        reading.air,
        math.nan if reading.air_2 is None else reading.air_2,
        reading.heater or 0.0,
        reading.compressor or 0.0,
        reading.fan or 0.0,
        reading.humidity or 0.0,
        PHASES.index(step.phase) if step is not None and known else -1,
        step.cycle if step is not None else 0,
    )


def _run(rows: list[tuple[float, ...]]) -> ChamberRun:
    columns = np.array(rows).T
    names = [item.name for item in fields(ChamberRun)]
    table = {name: np.ascontiguousarray(columns[i]) for i, name in enumerate(names)}
    for name in ('phase', 'cycle'):
        table[name] = table[name].astype(np.int64)
    return ChamberRun(**table)
