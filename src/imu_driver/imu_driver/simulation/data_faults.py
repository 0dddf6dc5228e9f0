# SPDX-License-Identifier: Apache-2.0
"""Faults of data rather than of physics: errors between the sensor and the file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, STANDARD_GRAVITY, ImuRecording
from imu_recording.user_error import UserError

from imu_driver.board.lsm9ds1 import COUNT_MAX
from imu_driver.simulation.run import DeviceRun

Recordings: TypeAlias = list[ImuRecording]
Fault: TypeAlias = Callable[[Sequence[ImuRecording], str, float, np.random.Generator], Recordings]


def _with(recording: ImuRecording, sensor: str, values: np.ndarray) -> ImuRecording:
    changed: dict[str, Any] = {SENSOR_FIELDS[sensor]: values}
    return replace(recording, **changed)


def _values(recording: ImuRecording, sensor: str) -> np.ndarray:
    values: np.ndarray = getattr(recording, SENSOR_FIELDS[sensor]).copy()
    return values


def stick(
    recordings: Sequence[ImuRecording], sensor: str, size: float, generator: np.random.Generator
) -> Recordings:
    """The bus hangs: a triad repeats itself, 3 + `size` times per run for some minutes."""
    changed = []
    for recording in recordings:
        values = _values(recording, sensor)
        for _ in range(3 + round(size)):
            length = max(int(generator.uniform(60, 300) / _period(recording)), 4)
            first = int(generator.integers(0, max(len(values) - length, 1)))
            values[first : first + length] = values[first]
        changed.append(_with(recording, sensor, values))
    return changed


def spike(
    recordings: Sequence[ImuRecording], sensor: str, size: float, generator: np.random.Generator
) -> Recordings:
    """Bit errors: single rows 15 to 60 σ away, 10 + 10·`size` per run."""
    changed = []
    for recording in recordings:
        values = _values(recording, sensor)
        rows = generator.choice(len(values) - 2, round(10 + 10 * size), replace=False) + 1
        axis = generator.integers(0, 3, len(rows))
        sigma = np.diff(values, axis=0).std(axis=0) / np.sqrt(2.0)
        way = generator.choice([-1.0, 1.0], len(rows))
        values[rows, axis] += way * generator.uniform(15.0, 60.0, len(rows)) * sigma[axis]
        changed.append(_with(recording, sensor, values))
    return changed


def flip(
    recordings: Sequence[ImuRecording], sensor: str, size: float, generator: np.random.Generator
) -> Recordings:
    """The device is taken out and put back upside down before the last cycle."""
    del sensor, size
    which = int(generator.integers(len(recordings)))
    recording = recordings[which]
    if recording.cycle is None or recording.cycle.max() < 2:
        raise UserError('orientation_flip needs a profile with at least two cycles')
    last = int(np.flatnonzero(recording.cycle == recording.cycle.max())[0])
    up = 'xyz'.index(recording.up_axis[1])
    turn = -np.ones(3)
    turn[(up + 1) % 3] = 1.0
    for name in ('accelerometer', 'magnetometer'):
        values = _values(recording, name)
        values[last:] += (turn - 1.0) * values.mean(axis=0)  # its errors stay as they are
        recording = _with(recording, name, values)
    return [recording if k == which else other for k, other in enumerate(recordings)]


UNIT_FACTORS = {
    'accelerometer': 1.0 / STANDARD_GRAVITY,
    'gyroscope': 180.0 / np.pi,
    'magnetometer': 1e6,
}
"""Factors from SI to g, °/s, µT."""


def mismatch(
    recordings: Sequence[ImuRecording], sensor: str, size: float, generator: np.random.Generator
) -> Recordings:
    """One run is in other units: g instead of m/s², °/s instead of rad/s, µT instead of T."""
    del size
    which = int(generator.integers(len(recordings)))
    return [
        _with(r, sensor, _values(r, sensor) * UNIT_FACTORS[sensor]) if k == which else r
        for k, r in enumerate(recordings)
    ]


def saturate(runs: Sequence[DeviceRun], sensor: str, size: float) -> list[DeviceRun]:
    """Return runs in which one axis reaches the rail for 10 to 40 % of the time."""
    share = min(0.10 + 0.05 * size, 0.4)
    changed = []
    for run in runs:
        part = run.device.sensor(sensor)
        rail = COUNT_MAX * part.sensitivity
        axis = int(np.argmax(np.abs(part.slope)))
        error = run.errors[sensor].copy()
        level = error[:, axis] + (1.0 + part.scale_error[axis]) * run.true_input(sensor)[axis]
        error[:, axis] += rail - np.quantile(level, 1.0 - share)
        changed.append(replace(run, errors={**run.errors, sensor: error}))
    return changed


def _period(recording: ImuRecording) -> float:
    return float(np.median(np.diff(recording.stamp[:1000]))) * 1e-9


FAULTS: dict[str, Fault] = {
    'stuck_value': stick,
    'spikes': spike,
    'orientation_flip': flip,
    'unit_mismatch': mismatch,
}
"""Name → change of finished recordings."""
