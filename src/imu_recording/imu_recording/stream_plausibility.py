# SPDX-License-Identifier: Apache-2.0
"""The checks of `plausibility` on a live stream, repeated over its newest samples."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from imu_recording.plausibility import POSSIBLE_RANGES, assess, possible
from imu_recording.recording import SECOND_NS, ImuRecording
from imu_recording.ros.messages import ImuSample, Vector

FIRST_SAMPLES = 20
"""Number of samples of the first check: of their size, not yet whether the device rests."""
WINDOW_S = 10.0
"""Length of the windows that are checked afterwards [s]."""
WINDOW_NS = round(WINDOW_S * SECOND_NS)
LEAST_WINDOW_SAMPLES, MOST_WINDOW_SAMPLES = 100, 4096
"""Least and greatest number of samples of such a window."""
JUMP_BACK_NS = SECOND_NS
"""Step back of the stamps from which the stream has started anew; less is a late sample [ns]."""

Row = tuple[int, Vector, Vector, Vector, float]
_RATE_RANGE, _FORCE_RANGE, _FIELD_RANGE = (
    POSSIBLE_RANGES[field]
    for field in ('angular_velocity', 'linear_acceleration', 'magnetic_field')
)
UNKNOWN_VECTOR: Vector = (np.nan, np.nan, np.nan)


@dataclass
class StreamCheck:
    """Checks the stream of one device as `admitted` checks a recording."""

    objection: str = ''
    """Why the newest window cannot be in SI units; '' where it can."""
    damaged: int = 0
    """Single impossible samples since the start."""
    damaged_at: int = -1
    """Stamp of the newest sample before the last of them [ns]."""
    newest: int = -1
    _rows: list[Row] = field(default_factory=list)
    _checked_first: bool = False
    _standing: int = 0
    _field: Vector = UNKNOWN_VECTOR
    _temperature: float = np.nan

    def on_temperature(self, temperature: float) -> bool:
        """Take in a die temperature [°C]; tell whether it is possible."""
        self._temperature = temperature
        return self._counted(possible('temperature', temperature))

    def on_magnetic_field(self, magnetic_field: Vector) -> bool:
        """Take in a magnetic field [T]; tell whether it is possible."""
        self._field = magnetic_field
        return self._counted(_within(magnetic_field, *_FIELD_RANGE))

    def on_imu(self, sample: ImuSample) -> bool:
        """Take in a sample; tell whether it is possible. `objection` is up to date afterwards."""
        rate, force = sample.angular_velocity, sample.linear_acceleration
        if sample.stamp > self.newest:
            self.newest, self._standing = sample.stamp, 0
            rows = self._rows
            rows.append((sample.stamp, rate, force, self._field, self._temperature))
            count, waited = len(rows), sample.stamp - rows[0][0]
            if count == FIRST_SAMPLES or count >= MOST_WINDOW_SAMPLES or waited >= WINDOW_NS:
                self._check()
        elif sample.stamp < self.newest - JUMP_BACK_NS:
            self.newest, self._rows = sample.stamp, []
        else:
            self._standing += 1
            if self._standing >= FIRST_SAMPLES:
                self.objection = f'the stamps stand still at {sample.stamp} ns'
        if _within(rate, *_RATE_RANGE) and _within(force, *_FORCE_RANGE):
            return True
        return self._counted(is_possible=False)

    @property
    def damaged_now(self) -> bool:
        """Whether an impossible sample came within the last WINDOW_S."""
        return self.damaged > 0 and self.newest - self.damaged_at < WINDOW_NS

    def _counted(self, is_possible: bool) -> bool:
        if not is_possible:
            self.damaged, self.damaged_at = self.damaged + 1, self.newest
        return is_possible

    def _check(self) -> None:
        count = len(self._rows)
        first = not self._checked_first and count == FIRST_SAMPLES
        long = self.newest - self._rows[0][0] >= WINDOW_NS and count >= LEAST_WINDOW_SAMPLES
        if first or long or count >= MOST_WINDOW_SAMPLES:
            self.objection = assess(_recording(self._rows))[1]
            self._checked_first = True
            if not first:
                self._rows = []


def _within(vector: Vector, low: float, high: float) -> bool:
    """Tell whether all components are within limits; NaN can be anything, as in `possible`."""
    x, y, z = vector
    return not (x < low or y < low or z < low or x > high or y > high or z > high)


def _recording(rows: list[Row]) -> ImuRecording:
    stamp, rate, force, magnetic, temperature = zip(*rows, strict=True)
    return ImuRecording(
        stamp=np.array(stamp, np.int64),
        angular_velocity=np.array(rate, float),
        linear_acceleration=np.array(force, float),
        magnetic_field=np.array(magnetic, float),
        temperature=np.array(temperature, float),
    )
