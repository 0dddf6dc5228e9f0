# SPDX-License-Identifier: Apache-2.0
"""Faults of a die thermometer, the same in a recording and in a live stream."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from imu_recording.recording import FloatArray

FEWEST_MEASUREMENTS = 50
"""Measurements from which a thermometer is assessed."""
LEAST_MISSING_ROWS = 20
"""Number of missing values that is a fault."""
LONGEST_CONSTANT_S = 600.0
"""Longest time of one value; a thermometer's counts scatter, so more is a failure [s]."""
WHOLE_DEGREE_TOLERANCE_K = 1e-6
"""Largest distance from a whole degree: the rounding of single precision [K]."""


def is_constant(values: FloatArray) -> bool:
    """Tell whether all values (n,) are the same."""
    return len(values) > 0 and bool((values == values[0]).all())


def is_whole_degrees(values: FloatArray) -> bool:
    """Tell whether values (n,) [°C] are whole degrees, and not all the same."""
    whole = np.abs(values - np.round(values)) <= WHOLE_DEGREE_TOLERANCE_K
    return bool(whole.all()) and not is_constant(values)


@dataclass
class LiveThermometer:
    """Watches the values of a thermometer one by one; `fault` is up to date after each.

    >>> thermometer = LiveThermometer()
    >>> for k in range(60):
    ...     thermometer.add(k * 1_000_000_000, 20.0 + k // 30)
    >>> thermometer.fault
    'temperature in whole degrees'
    """

    _missing: int = 0
    _value: float = nan
    _since: int = 0
    """Stamp of the first of the newest equal values [ns]."""
    _equal: int = 0
    _newest: int = 0
    _whole: int = 0
    """Whole degrees in a row."""
    _whole_values: int = 0
    """Changes of the value among them."""

    def add(self, stamp: int, temperature: float) -> None:
        """Take in a value [°C] measured at `stamp` [ns]."""
        self._newest = stamp
        if not isfinite(temperature):
            self._missing += 1
            return
        self._missing = 0
        changed = temperature != self._value
        if changed or stamp < self._since:
            self._value, self._since, self._equal = temperature, stamp, 0
        self._equal += 1
        if abs(temperature - round(temperature)) <= WHOLE_DEGREE_TOLERANCE_K:
            self._whole += 1
            self._whole_values += changed
        else:
            self._whole = self._whole_values = 0

    @property
    def fault(self) -> str:
        """What is wrong with the thermometer; '' where it is in order."""
        if self._missing >= LEAST_MISSING_ROWS:
            return 'the thermometer has no value (NaN)'
        seconds = (self._newest - self._since) * 1e-9
        if self._equal >= FEWEST_MEASUREMENTS and seconds >= LONGEST_CONSTANT_S:
            return f'the thermometer stands at {self._value:g} °C for {seconds / 60.0:.0f} min'
        if self._whole >= FEWEST_MEASUREMENTS and self._whole_values > 1:
            return 'temperature in whole degrees'
        return ''
