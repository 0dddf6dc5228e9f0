# SPDX-License-Identifier: Apache-2.0
"""A grid of an effect's shape parameters that is as fine as the effect is narrow.

A search for a dip of 3 K in steps of 7.5 K misses it. Values are added between neighbours on the
grid until the columns of all neighbours are correlated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import prod
from typing import Any

import numpy as np
from imu_recording.recording import STANDARD_GRAVITY, FloatArray

from thermal_comp.data.conditions import CHANNELS, Conditions, Sensor

NEIGHBOUR_CORRELATION = 0.7
"""Correlation of the columns of neighbours, beside a line in temperature, at least."""
MOST_VALUES = 65
"""Largest number of values of one parameter."""
MOST_FORMS = 400
"""Largest number of forms of an effect of several parameters."""
CYCLE_HOURS, CYCLE_ROWS = 12.0, 1441
"""Length and rows of the example."""
COLDEST_C, HOTTEST_C = -45.0, 90.0
"""Temperatures between which it swings [°C]."""


def refined(values: Sequence[float], columns_at: Callable[[float], FloatArray]) -> list[float]:
    """Return the values, with more between neighbours whose columns are not correlated.

    `columns_at` gives the effect's (n, …) columns on `example_cycle` at a value.
    """
    even = values[0] <= 0.0
    known = {value: _form(columns_at(value)) for value in values}
    while True:
        ordered = sorted(known)
        added = [
            0.5 * (low + high) if even else float(np.sqrt(low * high))
            for low, high in pairwise(ordered)
            if abs(known[low] @ known[high]) < NEIGHBOUR_CORRELATION
        ]
        if not added or len(known) + len(added) > MOST_VALUES:
            return ordered
        known |= {value: _form(columns_at(value)) for value in added}


def thinned(values: Sequence[list[float]]) -> list[list[float]]:
    """Return the values of several parameters, so few that their forms stay countable."""
    kept = list(values)
    while prod(map(len, kept)) > MOST_FORMS:
        longest = max(range(len(kept)), key=lambda k: len(kept[k]))
        kept[longest] = kept[longest][::2]
    return kept


def _form(columns: FloatArray) -> FloatArray:
    """Return the first of (n, …) columns with a line in temperature taken out; norm 1."""
    column = columns.reshape(len(columns), -1)[:, 0]
    line = np.column_stack([np.ones(CYCLE_ROWS), _temperature()])
    left = column - line @ np.linalg.lstsq(line, column, rcond=None)[0]
    norm = float(np.linalg.norm(left))
    unit: FloatArray = (
        left / norm if norm > 1e-12 * np.linalg.norm(column) else np.zeros(CYCLE_ROWS)
    )
    return unit


def _temperature() -> FloatArray:
    swing = np.abs(np.linspace(0.0, 4.0, CYCLE_ROWS) % 2.0 - 1.0)
    temperature: FloatArray = COLDEST_C + (HOTTEST_C - COLDEST_C) * swing
    return temperature


def example_cycle(sensor: Sensor) -> Conditions:
    """Return two slow cycles through all temperatures, with every channel."""
    time = np.linspace(0.0, CYCLE_HOURS * 3600.0, CYCLE_ROWS)
    temperature = _temperature()
    switch = (np.arange(CYCLE_ROWS) % 7 < 3).astype(float)
    channels: dict[str, Any] = dict.fromkeys(CHANNELS, switch)
    channels |= {
        'chamber_temperature': np.roll(temperature, -10),
        'chamber_temperature_2': np.roll(temperature, -10),
        'device_temperature': np.roll(temperature, -5),
        'setpoint': temperature,
        'humidity': 0.5 + 0.3 * (temperature > 20.0),
        'supply_voltage': 3.3 + 0.1 * switch,
        'vibration': np.column_stack([0.1 * switch] * 3),
        'phase': np.full(CYCLE_ROWS, 3, dtype=np.int64),
        'cycle': 1 + np.arange(CYCLE_ROWS, dtype=np.int64) // (CYCLE_ROWS // 2 + 1),
    }
    return Conditions(
        time=time,
        temperature=temperature,
        specific_force=np.full((CYCLE_ROWS, 3), STANDARD_GRAVITY / np.sqrt(3.0)),
        angular_velocity=np.full((CYCLE_ROWS, 3), 0.1),
        magnetic_field=np.full((CYCLE_ROWS, 3), 3e-5),
        sensor=sensor,
        orientation=np.eye(3),
        **channels,
    )
