# SPDX-License-Identifier: Apache-2.0
"""Input (readings), state (progress) and output (actions) of the sequencer, as plain values."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, TypeAlias

IDLE, CHECK, RUN, PAUSED = 'IDLE', 'CHECK', 'RUN', 'PAUSED'
HOLD_FAULT, SAFE, DONE, ABORTED = 'HOLD_FAULT', 'SAFE', 'DONE', 'ABORTED'
"""Modes of a run."""
FINISHED = (DONE, ABORTED)
CONTROLLING = (RUN, PAUSED, HOLD_FAULT)
"""Modes in which the profile controls the chamber."""

MOVE, SETTLE, DWELL, CONFIRM, STOP = 'move', 'settle', 'dwell', 'confirm', 'stop'
"""Stages of a step: ramp, stabilise, dwell, ask the operator, switch off."""

LINK_OK, LINK_FAILING, LINK_LOST = 'ok', 'failing', 'lost'


@dataclass(frozen=True)
class Readings:
    """Readings of chamber, devices and recording at one moment."""

    time: float
    """Monotonic time of the sequencer [s]."""
    link: str = LINK_OK
    """'ok', 'failing' (being retried) or 'lost' (retried in vain)."""
    air: float | None = None
    """Air temperature [°C]."""
    device: float | None = None
    """Thermocouple on the device [°C]."""
    setpoint: float | None = None
    """Set-point the chamber reports [°C]."""
    running: bool | None = None
    """Whether the chamber reports that it conditions the air."""
    alarms: tuple[str, ...] = ()
    imu_alive: bool = True
    """False: an IMU is required and has been silent for 10 s."""
    disk_free: float = float('inf')
    """Free space where the run is recorded [bytes]."""
    fault: str = ''
    """Fault of recorder, journal or reference logger; '' none."""


@dataclass(frozen=True)
class Progress:
    """State of a run, as the journal keeps it; a restart continues from it."""

    mode: str = IDLE
    step: int = 0
    stage: str = MOVE
    setpoint: float | None = None
    """Programmed temperature [°C]; None before the run was first started."""
    reason: str = ''
    """Why PAUSED, HOLD_FAULT, SAFE or ABORTED; '' otherwise."""
    aborting: bool = False
    """The run was going to the safe state: after a restart it goes there."""
    interruptions: int = 0
    """Number of restarts after a crash, kill or power cut."""


@dataclass(frozen=True)
class Note:
    """Write a line of the journal and sync it to disk before the next action."""

    event: str
    progress: Progress
    details: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ProgramLimits:
    """Program the limits of the chamber's own protection [°C]."""

    low_c: float
    high_c: float


@dataclass(frozen=True)
class WriteSetpoint:
    """Write the set-point [°C]."""

    temperature_c: float


@dataclass(frozen=True)
class Switch:
    """Switch the conditioning of the air on, or go to stand-by."""

    on: bool


Action: TypeAlias = Note | ProgramLimits | WriteSetpoint | Switch
