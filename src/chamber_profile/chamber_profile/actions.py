# SPDX-License-Identifier: Apache-2.0
"""Carry out what the sequencer asks for: journal first, then the chamber, in order."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from chamber_profile.chambers.chamber import Chamber, ChamberReading
from chamber_profile.sequence_types import (
    Action,
    Note,
    ProgramLimits,
    Readings,
    Switch,
    WriteSetpoint,
)


def carry_out(actions: Iterable[Action], chamber: Chamber, note: Callable[[Note], None]) -> None:
    """Carry out the actions in order; ChamberError from the chamber leaves the rest undone."""
    for action in actions:
        match action:
            case Note():
                note(action)
            case ProgramLimits():
                chamber.set_limits(action.low_c, action.high_c)
            case WriteSetpoint():
                chamber.set_temperature(action.temperature_c)
            case Switch(on=True):
                chamber.run()
            case Switch():
                chamber.stop()


def readings_of(time: float, reading: ChamberReading) -> Readings:
    """Return the sequencer's view of a chamber reading, all else being well."""
    return Readings(
        time=time,
        air=reading.air,
        device=reading.device,
        setpoint=reading.setpoint,
        running=reading.running,
        alarms=reading.alarms,
    )
