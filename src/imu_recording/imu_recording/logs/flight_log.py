# SPDX-License-Identifier: Apache-2.0
"""The IMUs in the log of an autopilot, whatever its format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from imu_recording.recording import FloatArray, IntArray, RecordingError

WHOLE_FILE_BYTES = 200_000_000
"""Size up to which a file is read as a whole; a longer one is averaged."""
MOST_KEPT_ROWS = 1_000_000
"""Largest number of rows of a longer file that are kept of each kind of message, all sensors
together."""


class LogError(RecordingError):
    """A log that cannot be used; the message names the file and a way out."""


@dataclass(frozen=True, eq=False)
class Series:
    """Samples of one sensor as they stand in the log."""

    time: IntArray
    """(n,) on the log's clock, since power-on [ns]."""
    values: FloatArray
    """(n, k) in SI units, °C for temperatures."""


@dataclass(frozen=True, eq=False)
class LoggedImu:
    """One accelerometer with the gyroscope, magnetometer and thermometers that go with it."""

    number: int
    """Counted from 0."""
    gyroscope: Series
    accelerometer: Series
    temperature: Series
    """Of the die, (n, 1)."""
    magnetometer: Series | None = None
    barometer_temperature: Series | None = None
    """Of the barometer's chip, on the same board, (n, 1)."""
    pressure: Series | None = None
    """Of the air by the barometer [Pa], (n, 1)."""
    hardware: Mapping[str, str] = field(default_factory=dict)
    """Names and device IDs."""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class FlightLog:
    """The log of one vehicle."""

    vehicle: str
    """Autopilot and serial number of the board, or the name of the file."""
    imus: Sequence[LoggedImu]
    parameters: Mapping[str, float]
    hardware: Mapping[str, str]
    """What the log says of board and firmware."""
    power_on: int | None = None
    """When the log's clock was zero, Unix time [ns], by GPS; None where it does not tell."""
    path: str = ''
    """File it was read from."""
    notes: tuple[str, ...] = ()
    """What was damaged or left out."""

    @property
    def name(self) -> str:
        """Name of the file without its suffix."""
        return Path(self.path).stem


def with_temperature(path: Path, imus: Sequence[LoggedImu], way_out: str) -> list[LoggedImu]:
    """Return the IMUs that have a temperature; raise LogError with the way out where none has."""
    known = [imu for imu in imus if np.isfinite(imu.temperature.values).any()]
    if not known:
        raise LogError(f'{path}: no IMU has a temperature; {way_out}')
    return known


def check_columns(path: Path, name: str, table: Mapping[str, Any], needed: Sequence[str]) -> None:
    """Refuse messages whose damaged definition lacks columns; the first is their integer time."""
    missing = [column for column in needed if column not in table]
    if missing or np.asarray(table[needed[0]]).dtype.kind not in 'iu':
        raise LogError(
            f'{path}: the definition of {name} messages is damaged or foreign: no usable '
            f'{", ".join(missing or needed[:1])}'
        )
