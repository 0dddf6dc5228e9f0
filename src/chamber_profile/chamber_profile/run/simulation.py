# SPDX-License-Identifier: Apache-2.0
"""A whole run of a profile on a simulated chamber, faster than real time, as columns."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import PHASES, FloatArray, IntArray
from imu_recording.user_error import UserError

from chamber_profile.chambers import climate as physics
from chamber_profile.chambers.climate import Climate
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
    states = [chamber.state[None].copy()]
    orders: list[tuple[float, ...]] = []
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
        orders.append((chamber.setpoint, float(chamber.running), *_marks(step)))
        states.append(chamber.advance(TICK_S))
        time += TICK_S
    if sequencer.progress.mode != DONE:
        raise UserError(f'the simulated chamber cannot run {profile.name}: {notes[-1].progress}')
    held = np.repeat(np.array(orders), TICK_S, axis=0)
    rows = np.ascontiguousarray(np.concatenate(states)[:-1:period])
    return _run(rows, held[::period], chamber.climate, period)


def _marks(step: Step | None) -> tuple[int, int]:
    """Return number of the phase, −1 in operator steps, and cycle of a step."""
    if step is None:
        return -1, 0
    return PHASES.index(step.phase) if step.phase in PHASES else -1, step.cycle


def _run(states: FloatArray, orders: FloatArray, climate: Climate, period: int) -> ChamberRun:
    """Return the columns of states (n, STATE_SIZE) under orders (n, 4): as `orders` has them."""
    temperature, temperature_2, humidity = physics.sensed(states, climate)
    setpoint, running, phase, cycle = (np.ascontiguousarray(column) for column in orders.T)
    return ChamberRun(
        time=np.arange(0.0, len(states) * period, period),
        setpoint=setpoint,
        air=states[:, physics.AIR] + states[:, physics.EDDY],
        temperature=temperature.round(2),
        temperature_2=temperature_2.round(2),
        heater=states[:, physics.HEATER].copy(),
        compressor=states[:, physics.COMPRESSOR].copy(),
        fan=running,
        humidity=humidity,
        phase=phase.astype(np.int64),
        cycle=cycle.astype(np.int64),
    )
