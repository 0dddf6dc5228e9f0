# SPDX-License-Identifier: Apache-2.0
"""When a profile does what: the ideal timetable, and its set-point at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray

from chamber_profile.profile.unroll import closed_steps
from chamber_profile.profile.values import Profile


@dataclass(frozen=True)
class Entry:
    """One step on the ideal clock: a chamber without lag, an operator who takes as expected."""

    id: str
    kind: str
    phase: str
    cycle: int
    orientation: str
    start_s: float
    move_s: float
    """Time the set-point is on its way [s]."""
    dwell_s: float
    from_c: float
    to_c: float

    @property
    def end_s(self) -> float:
        """End of the step [s]."""
        return self.start_s + self.move_s + self.dwell_s


def timetable(profile: Profile, start_c: float | None = None) -> tuple[Entry, ...]:
    """Return the steps with their times, beginning at `start_c` (default: the first target)."""
    time, here = 0.0, profile.start_c if start_c is None else start_c
    entries = []
    for step in closed_steps(profile):
        move = abs(step.target_c - here) / step.rate_c_per_min * 60.0
        stay = step.expected_s if step.kind == 'operator' else step.dwell_s
        entry = Entry(
            step.id,
            step.kind,
            step.phase,
            step.cycle,
            step.orientation,
            time,
            move,
            stay,
            here,
            step.target_c,
        )
        entries.append(entry)
        time, here = entry.end_s, step.target_c
    return tuple(entries)


def setpoint_corners(entries: tuple[Entry, ...]) -> tuple[FloatArray, FloatArray]:
    """Return time [s] and set-point [°C] of the corners; between them it is a straight line."""
    time, setpoint = [entries[0].start_s], [entries[0].from_c]
    for entry in entries:
        if entry.move_s:
            time.append(entry.start_s + entry.move_s)
            setpoint.append(entry.to_c)
        if entry.dwell_s:
            time.append(entry.end_s)
            setpoint.append(entry.to_c)
    return np.array(time), np.array(setpoint)
