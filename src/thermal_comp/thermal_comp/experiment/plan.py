# SPDX-License-Identifier: Apache-2.0
"""A thermal cycle as a list of segments, and the temperatures of chamber and device in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np
from imu_recording.recording import STANDARD_GRAVITY, FloatArray

from thermal_comp.data.conditions import Conditions, mounting_rotation
from thermal_comp.effects.operators import follow

PERIOD_S = 20.0
"""Step of the prediction [s]."""
PRECONDITION_S, FINAL_S = 3600.0, 1800.0
"""Dwells before the first cycle and after the last [s]."""
REFERENCE_C = 20.0
"""Temperature of both, and at which every cycle begins [°C]."""
AIR_LAG_S, DIE_LAG_S = 90.0, 240.0
"""Time constants of the chamber's air behind the set-point and of the die behind the air [s]."""
COOLING_C_PER_MIN, HEATING_C_PER_MIN = 1.3, 2.5
"""Greatest rates of the air in a chamber of this class [°C/min]."""
CHAMBER_FIELD_T = np.array([0.0, 22e-6, -42e-6])
"""Magnetic field in the chamber, z up [T]."""


@dataclass(frozen=True)
class Segment:
    """Go to a temperature at a rate, then stay."""

    target: float
    """[°C]."""
    rate: float
    """[°C/min]."""
    dwell: float
    """[s]."""


@dataclass(frozen=True)
class Plan:
    """A cycle that is repeated, between preconditioning and a final dwell."""

    cycle: tuple[Segment, ...]
    repeats: int

    @property
    def cycle_s(self) -> float:
        """Length of one cycle by the set-point [s]."""
        level, total = REFERENCE_C, 0.0
        for segment in self.cycle:
            total += abs(segment.target - level) / segment.rate * 60.0 + segment.dwell
            level = segment.target
        return total

    @property
    def hours(self) -> float:
        """Length of a run by the set-point [h]."""
        return (PRECONDITION_S + self.repeats * self.cycle_s + FINAL_S) / 3600.0


PAPER_PLAN = Plan(
    (Segment(-10.0, 2.0, 1800.0), Segment(50.0, 2.0, 1800.0), Segment(20.0, 2.0, 1800.0)), 4
)
"""The plan of Betta et al. 2022."""


def set_points(plan: Plan) -> tuple[FloatArray, FloatArray]:
    """Return the set-point [°C] every PERIOD_S and the number of the cycle (0 outside)."""
    levels, cycles = [np.full(int(PRECONDITION_S / PERIOD_S), REFERENCE_C)], []
    cycles.append(np.zeros(len(levels[0])))
    for number in range(1, plan.repeats + 1):
        level = REFERENCE_C
        for segment in plan.cycle:
            ramp_s = abs(segment.target - level) / segment.rate * 60.0
            steps = ceil(ramp_s / PERIOD_S - 1e-9)  # never faster than asked for
            levels.append(np.linspace(level, segment.target, steps + 1)[1:])
            levels.append(np.full(int(segment.dwell / PERIOD_S), segment.target))
            cycles += [np.full(len(part), float(number)) for part in levels[-2:]]
            level = segment.target
    levels.append(np.full(int(FINAL_S / PERIOD_S), REFERENCE_C))
    cycles.append(np.zeros(len(levels[-1])))
    return np.concatenate(levels), np.concatenate(cycles)


def predict_runs(plan: Plan, up_axes: Sequence[str] = ('+x', '+y', '+z')) -> list[Conditions]:
    """Return the conditions each run of the plan is expected to have."""
    setpoint, cycle = set_points(plan)
    time: FloatArray = (np.arange(len(setpoint), dtype=np.float64) + 0.5) * PERIOD_S
    air = _air(setpoint)
    die, _ = follow(time, air, DIE_LAG_S)
    outer, _ = follow(time, air, 0.6 * DIE_LAG_S)
    power = np.gradient(air, PERIOD_S) * AIR_LAG_S + 0.15 * (air - REFERENCE_C)
    compressor = (setpoint < 30.0).astype(float)
    runs = []
    for up in up_axes:
        rotation = mounting_rotation(up)
        n = len(time)
        runs.append(
            Conditions(
                time=time,
                temperature=die,
                specific_force=np.tile(rotation @ [0.0, 0.0, STANDARD_GRAVITY], (n, 1)),
                angular_velocity=np.zeros((n, 3)),
                magnetic_field=np.tile(rotation @ CHAMBER_FIELD_T, (n, 1)),
                orientation=rotation,
                chamber_temperature=air,
                device_temperature=outer,
                humidity=np.clip(0.5 * np.exp(-(air - REFERENCE_C) / 15.0), 0.02, 1.0),
                heater=np.clip(0.3 + power / 6.0, 0.0, 1.0),
                compressor=compressor,
                fan=np.ones(n),
                supply_voltage=3.3 + 0.002 * (air - REFERENCE_C) / 30.0,
                vibration=np.tile(0.02 * compressor[:, None], (1, 3)),
                setpoint=setpoint,
                cycle=cycle.astype(np.int64),
            )
        )
    return runs


def _air(setpoint: FloatArray) -> FloatArray:
    """Return the chamber's air behind the set-point: a lag of limited rate [°C]."""
    air = np.empty_like(setpoint)
    level = air[0] = setpoint[0]
    down = -COOLING_C_PER_MIN * PERIOD_S / 60.0
    up = HEATING_C_PER_MIN * PERIOD_S / 60.0
    share = 1.0 - np.exp(-PERIOD_S / AIR_LAG_S)
    for i in range(1, len(setpoint)):
        level += min(max((setpoint[i] - level) * share, down), up)
        air[i] = level
    return air
