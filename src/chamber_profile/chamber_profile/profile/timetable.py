# SPDX-License-Identifier: Apache-2.0
"""The ideal timetable of a profile, and its set-point over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray

from chamber_profile.profile.unroll import closed_steps
from chamber_profile.profile.values import Profile


@dataclass(frozen=True)
class Entry:
    """One step with its times, for a chamber without lag and an operator as fast as expected."""

    id: str
    kind: str
    phase: str
    cycle: int
    orientation: str
    start_s: float
    move_s: float
    """Time of the set-point's ramp [s]."""
    dwell_s: float
    from_c: float
    to_c: float

    @property
    def end_s(self) -> float:
        """End of the step [s]."""
        return self.start_s + self.move_s + self.dwell_s


def timetable(profile: Profile, start_c: float | None = None) -> tuple[Entry, ...]:
    """Return the steps with their times, beginning at `start_c` (default: the first target)."""
    time, setpoint = 0.0, profile.start_c if start_c is None else start_c
    entries = []
    for step in closed_steps(profile):
        entry = Entry(
            id=step.id,
            kind=step.kind,
            phase=step.phase,
            cycle=step.cycle,
            orientation=step.orientation,
            start_s=time,
            move_s=step.ramp_s(setpoint),
            dwell_s=step.hold_s,
            from_c=setpoint,
            to_c=step.target_c,
        )
        entries.append(entry)
        time, setpoint = entry.end_s, step.target_c
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
