# SPDX-License-Identifier: Apache-2.0
"""The die's thermometer beside others of the same stream: a copy of one, or on another scale.

The checks are those of a recording (`thermometer`), over the newest hours of what came.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from imu_recording.logging_contract import THERMOMETER_FIELDS
from imu_recording.recording import ImuRecording

from thermal_comp.data.thermometer import copied_from, wrong_scale

ROW_NS = 1_000_000_000
"""Distance of the rows that are kept [ns]."""
ROWS = 4 * 3600
"""Rows that are kept: enough for a ramp of a chamber, or a warm-up."""
JUDGED_FIRST = 60
"""Rows from which the checks are made …"""
JUDGED_AGAIN = 0.1
"""… and the share of new ones after which they are made again."""


class ThermometerComparison:
    """Takes in values of all thermometers as they come; `fault` says what they contradict.

    A row is judged once the next one is due: by then the others' values up to its stamp are here.
    """

    def __init__(self) -> None:
        self.fault = ''
        """What is wrong with the die's thermometer; '' where nothing speaks against it."""
        self._rows: deque[tuple[int, float, tuple[float, ...]]] = deque(maxlen=ROWS)
        self._waiting: tuple[int, float] | None = None
        self._others: dict[str, deque[tuple[int, float]]] = {
            name: deque(maxlen=64) for name in THERMOMETER_FIELDS
        }
        self._new = 0

    def on_other(self, name: str, stamp: int, temperature: float) -> None:
        """Take in a value [°C] of one of THERMOMETER_FIELDS, measured at `stamp` [ns]."""
        self._others[name].append((stamp, temperature))

    def on_die(self, stamp: int, temperature: float) -> None:
        """Take in a die temperature [°C] measured at `stamp` [ns]."""
        if self._waiting is None or stamp < self._waiting[0]:  # the first, or the clock jumped
            self._rows.clear()
            self._waiting = stamp, temperature
        elif stamp >= self._waiting[0] + ROW_NS:
            then = self._waiting[0]
            others = tuple(self._value(name, then) for name in THERMOMETER_FIELDS)
            if not np.isnan(others).all():
                self._rows.append((*self._waiting, others))
                self._new += 1
            self._waiting = stamp, temperature
            if self._new >= max(JUDGED_FIRST, JUDGED_AGAIN * len(self._rows)):
                self._new = 0
                self.fault = self._judged()

    def _value(self, name: str, stamp: int) -> float:
        """Return the newest value not later than `stamp`; NaN where there is none."""
        known = (value for then, value in reversed(self._others[name]) if then <= stamp)
        return next(known, np.nan)

    def _judged(self) -> str:
        stamp, die, others = zip(*self._rows, strict=True)
        unknown = np.full((len(stamp), 3), np.nan)
        tracks = np.array(others).T
        recording = ImuRecording(
            stamp=np.array(stamp, np.int64),
            angular_velocity=unknown,
            linear_acceleration=unknown,
            magnetic_field=unknown,
            temperature=np.array(die),
            **dict(zip(THERMOMETER_FIELDS, tracks, strict=True)),
        )
        if source := copied_from(recording):
            return f'the die temperature is a copy of {source}'
        if ratio := wrong_scale(recording):
            return f'the die moves {ratio:.2g} K for each kelvin around it: its scale is wrong'
        return ''
