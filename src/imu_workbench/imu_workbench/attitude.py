# SPDX-License-Identifier: Apache-2.0
"""Tables VI and VII: how steady the attitude of a resting device is, raw and compensated."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording, IntArray
from orientation_filters.filters import FILTERS, run_filter
from orientation_filters.flags import counts
from orientation_filters.rotation import (
    conjugate,
    euler_zyx,
    heading_angle,
    inclination_angle,
    multiply,
    normalised,
    rotation_angle,
)

from imu_workbench.decimate import decimated

START_S = 60.0
"""The start attitude is the mean over this long [s]."""
EULER = ('yaw', 'pitch', 'roll')
COLUMNS = (*EULER, 'rotation', 'heading', 'inclination')
"""Columns of `Attitude.angles`: ZYX Euler angles (the paper's α, β, γ), then what never wraps."""
CHUNK = 50_000
"""Rows whose angles are computed at a time: they stay in the cache."""
RAW, HALF, FULL = 'raw', 'magnetometer compensated', 'compensated'
"""What the filters are fed with; earlier versions of a model are `version 1` …"""
DRAWN = (RAW, FULL)
"""Of these there are lines and statistics cycle by cycle; of the others what the run says."""
BRIEF_STRIDE = 10
"""The others are looked at in every so many rows: their spread needs no more."""


@dataclass(frozen=True, eq=False)
class Attitude:
    """What a filter's estimate does relative to the start: angles in degrees."""

    filter: str
    data: str
    """What the filter was fed with."""
    statistics: list[dict[str, Any]]
    """Mean, standard deviation and largest value of each of COLUMNS: the run, then each cycle."""
    hours: Mapping[str, FloatArray]
    """Time of the lines [h], per Euler angle."""
    lines: Mapping[str, FloatArray]
    """The Euler angles over time [deg], decimated without losing an extreme."""
    nanoseconds_per_sample: float
    """Time the filter took on this machine, compiled and warm."""
    flags: Mapping[str, int]
    """Rows in which the filter said something, by flag."""


def estimate_attitudes(
    variants: Mapping[str, ImuRecording],
    *,
    filters: Sequence[str] = tuple(FILTERS),
    every: int = 1,
    points: int = 1000,
) -> Iterator[Attitude]:
    """Run each filter, as the paper has it, over every variant of a recording.

    Angles are taken of every `every`-th row; lines have about `points` points.
    """
    first = next(iter(variants.values()))
    seconds, cycle = first.time, first.cycle
    for name in filters:
        run_filter(name, first.rows(slice(0, 100)))  # compiles
        for data, recording in variants.items():
            start = time.thread_time()
            result = run_filter(name, recording)
            spent = time.thread_time() - start
            drawn = data in DRAWN
            stride = every if drawn else max(every, BRIEF_STRIDE)
            angles = angles_from_start(seconds, result.orientation, stride)
            hours: Mapping[str, FloatArray] = {}
            lines: Mapping[str, FloatArray] = {}
            if drawn:
                hours, lines = angle_lines(seconds[::stride] / 3600.0, angles, points)
            cycles = cycle[::stride] if drawn and cycle is not None else None
            yield Attitude(
                filter=name,
                data=data,
                statistics=angle_statistics(angles, cycles),
                hours=hours,
                lines=lines,
                nanoseconds_per_sample=1e9 * spent / max(1, len(recording)),
                flags=counts(result.flags),
            )


def angle_lines(
    hours: FloatArray, angles: FloatArray, points: int
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Return time and value of each Euler angle, decimated; a missing minute breaks the line."""
    found = {
        name: decimated(hours, angles[:, COLUMNS.index(name)], points, max_gap=1 / 60)
        for name in EULER
    }
    return {n: line[0] for n, line in found.items()}, {n: line[1] for n, line in found.items()}


def angle_statistics(angles: FloatArray, cycle: IntArray | None) -> list[dict[str, Any]]:
    """Return mean, standard deviation and largest of angles (n, 6): the run, then each cycle."""
    parts: dict[str, Any] = {'run': slice(None)}
    if cycle is not None:
        parts |= {f'R{number}': cycle == number for number in np.unique(cycle[cycle > 0])}
    return [{'part': name, **_part_statistics(angles[rows])} for name, rows in parts.items()]


def _part_statistics(angles: FloatArray) -> dict[str, dict[str, float]]:
    known = np.isfinite(angles[:, 0])
    if not known.any():
        return {}
    found: dict[str, dict[str, float]] = {'mean': {}, 'std': {}, 'largest': {}}
    for name, column in zip(COLUMNS, angles.T, strict=True):
        values = column if known.all() else column[known]
        found['mean'][name], found['std'][name] = _circular(values)
        found['largest'][name] = float(max(values.max(), -values.min()))
    return found


def angles_from_start(seconds: FloatArray, orientation: FloatArray, every: int = 1) -> FloatArray:
    """Return (n, 6) angles [deg] of orientations (n, 4) relative to their first minute's mean.

    Euler angles are about the sensor's axes at the start, heading and inclination about and away
    from the vertical. NaN where the filter has no attitude.
    """
    known = np.isfinite(orientation).all(axis=1)
    angles = np.full((len(orientation[::every]), len(COLUMNS)), np.nan, order='F')
    if not known.any():
        return angles
    first = seconds[known][0]
    early = orientation[known & (seconds < first + START_S)]
    signs = np.sign(early @ early[0])[:, None]
    start = conjugate(normalised((early * np.where(signs == 0, 1.0, signs)).mean(axis=0)))
    kept, rows = orientation[::every], np.flatnonzero(known[::every])
    for begin in range(0, len(rows), CHUNK):
        part = rows[begin : begin + CHUNK]
        q = kept[part]
        angles[part, :3] = euler_zyx(multiply(start, q))[:, ::-1]
        world = multiply(q, start)
        for column, measure in enumerate((rotation_angle, heading_angle, inclination_angle), 3):
            angles[part, column] = measure(world)
    return np.degrees(angles, out=angles)


def _circular(values: FloatArray) -> tuple[float, float]:
    """Return mean and standard deviation [deg] of angles (n,) that may wrap at ±180°.

    Deviations are taken the short way round: from the first value, then from their mean.
    """
    away = _wrapped(values - values[0])
    centre = float(values[0] + away.mean())
    away = _wrapped(np.subtract(values, centre, out=away))
    mean = centre + float(away.mean())
    return (mean + 180.0) % 360.0 - 180.0, float(away.std())


def _wrapped(difference: FloatArray) -> FloatArray:
    """Return differences of angles [deg] within ±180°, in place."""
    if max(difference.max(), -difference.min()) > 180.0:
        difference[difference > 180.0] -= 360.0
        difference[difference < -180.0] += 360.0
    return difference


def state_bytes(name: str) -> int:
    """Return the memory of a filter's state: eight bytes per number in it."""

    def numbers(value: Any) -> int:
        return sum(map(numbers, value)) if isinstance(value, tuple) else 1

    return 8 * numbers(FILTERS[name].initial_state())
