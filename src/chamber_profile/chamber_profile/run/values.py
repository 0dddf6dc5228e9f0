# SPDX-License-Identifier: Apache-2.0
"""What goes into the sequencer (readings) and what comes out (actions), as plain values."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, TypeAlias

IDLE, CHECK, RUN, PAUSED = 'IDLE', 'CHECK', 'RUN', 'PAUSED'
HOLD_FAULT, SAFE, DONE, ABORTED = 'HOLD_FAULT', 'SAFE', 'DONE', 'ABORTED'
"""States of a run."""
FINISHED = (DONE, ABORTED)
IN_CHARGE = (RUN, PAUSED, HOLD_FAULT)
"""States in which the profile moves or holds the chamber."""

MOVE, SETTLE, DWELL, CONFIRM, STOP = 'move', 'settle', 'dwell', 'confirm', 'stop'
"""Stages of a step: set-point on its way, wait for the temperature, stay, ask, switch off."""

LINK_OK, LINK_FAILING, LINK_LOST = 'ok', 'failing', 'lost'


@dataclass(frozen=True)
class Readings:
    """What is known about the world at one moment."""

    time: float
    """[s] of the sequencer's clock, never going back."""
    link: str = LINK_OK
    """'ok', 'failing' (being retried) or 'lost' (retried in vain)."""
    air: float | None = None
    """[°C]"""
    device: float | None = None
    """Thermocouple on the device [°C]."""
    setpoint: float | None = None
    """Set-point the chamber says it holds [°C]."""
    running: bool | None = None
    alarms: tuple[str, ...] = ()
    imu_alive: bool = True
    """False: required and silent for 10 s."""
    disk_free: float = float('inf')
    """[bytes]"""
    fault: str = ''
    """What recorder, journal or reference logger complain of; '' nothing."""


@dataclass(frozen=True)
class Progress:
    """Where a run is: what the journal keeps, and all a restart needs."""

    mode: str = IDLE
    step: int = 0
    stage: str = MOVE
    setpoint: float | None = None
    """Programmed temperature now [°C]; None before the chamber was ever moved."""
    reason: str = ''
    """Why PAUSED, HOLD_FAULT, SAFE or ABORTED; '' otherwise."""
    aborting: bool = False
    """The run was on its way to the safe state: a restart goes there, not on with the run."""
    interruptions: int = 0
    """How often the run was re-entered after a crash, kill or power cut."""


@dataclass(frozen=True)
class Note:
    """Write a journal line and sync it to disk; nothing after it happens before that."""

    event: str
    progress: Progress
    details: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ProgramLimits:
    """Program the chamber's own limits [°C]."""

    low_c: float
    high_c: float


@dataclass(frozen=True)
class WriteSetpoint:
    """Write the set-point [°C]."""

    temperature_c: float


@dataclass(frozen=True)
class Switch:
    """Condition the air, or go to stand-by."""

    on: bool


Action: TypeAlias = Note | ProgramLimits | WriteSetpoint | Switch
