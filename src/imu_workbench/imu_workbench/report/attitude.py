# SPDX-License-Identifier: Apache-2.0
"""Attitude of a recording, raw and compensated: angles from the start, their statistics."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from imu_recording.logging_contract import OPTIONAL_FIELDS
from imu_recording.recording import FloatArray, ImuRecording, IntArray
from numpy.typing import NDArray
from orientation_filters.filters import FILTERS, run_filter, sample_rate
from orientation_filters.result import flag_counts
from orientation_filters.rotation.arrays import (
    conjugate,
    euler_zyx,
    heading_angle,
    inclination_angle,
    multiply,
    normalised,
    rotation_angle,
)
from orientation_filters.upsampling import upsample
from thermal_comp.compensation.recording import compensate
from thermal_comp.data.startup import startup_rows
from thermal_comp.model.values import ThermalModel

from imu_workbench.report.series import decimated

START_ATTITUDE_S = 60.0
"""The start attitude is the mean over this long [s]."""
EULER = ('yaw', 'pitch', 'roll')
ANGLE_COLUMNS = (*EULER, 'rotation', 'heading', 'inclination')
"""Columns of `angles_from_start`: ZYX Euler angles (the paper's α, β, γ), then angles without
wrap."""
CHUNK_ROWS = 50_000
"""Rows whose angles are computed at a time: they stay in the cache."""
RAW, MAGNETOMETER_ONLY, FULL = 'raw', 'magnetometer compensated', 'compensated'
"""Input of the filters; under earlier versions of a model it is called `version 1` …"""
DRAWN_INPUTS = (RAW, FULL)
"""Inputs with lines and statistics of every cycle; others have statistics of the run only."""
UNDRAWN_STRIDE = 10
"""Of the others every so many rows are evaluated: enough for a standard deviation."""


@dataclass(frozen=True, eq=False)
class FilterAttitude:
    """Attitude of one filter relative to the start: angles [deg], their statistics, its cost."""

    filter: str
    data: str
    """Input of the filter."""
    statistics: list[dict[str, Any]]
    """Mean, standard deviation and largest value of each angle: the run, then each cycle."""
    hours: Mapping[str, FloatArray]
    """Time of the lines [h], per Euler angle."""
    lines: Mapping[str, FloatArray]
    """The Euler angles over time [deg], decimated without losing an extreme."""
    nanoseconds_per_sample: float
    """Time the filter took on this machine, compiled and warm."""
    flags: Mapping[str, int]
    """Number of rows with each flag of the filter."""


def estimate_attitudes(
    variants: Mapping[str, ImuRecording],
    *,
    filters: Sequence[str] = tuple(FILTERS),
    every: int = 1,
    points: int = 1000,
) -> Iterator[FilterAttitude]:
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
            drawn = data in DRAWN_INPUTS
            stride = every if drawn else max(every, UNDRAWN_STRIDE)
            angles = angles_from_start(seconds, result.orientation, stride)
            hours: Mapping[str, FloatArray] = {}
            lines: Mapping[str, FloatArray] = {}
            if drawn:
                hours, lines = angle_lines(seconds[::stride] / 3600.0, angles, points)
            cycles = cycle[::stride] if drawn and cycle is not None else None
            yield FilterAttitude(
                filter=name,
                data=data,
                statistics=angle_statistics(angles, cycles),
                hours=hours,
                lines=lines,
                nanoseconds_per_sample=1e9 * spent / max(1, len(recording)),
                flags=flag_counts(result.flags),
            )


def angle_lines(
    hours: FloatArray, angles: FloatArray, points: int
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Return time and value of each Euler angle, decimated; a missing minute breaks the line."""
    found = {
        name: decimated(hours, angles[:, ANGLE_COLUMNS.index(name)], points, max_gap=1 / 60)
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
    for name, column in zip(ANGLE_COLUMNS, angles.T, strict=True):
        values = column if known.all() else column[known]
        found['mean'][name], found['std'][name] = _circular(values)
        found['largest'][name] = float(max(values.max(), -values.min()))
    return found


def angles_from_start(seconds: FloatArray, orientation: FloatArray, every: int = 1) -> FloatArray:
    """Return (n, 6) angles [deg] of orientations (n, 4) relative to their first minute's mean.

    Euler angles are about the sensor's axes at the start, heading and inclination about and away
    from the vertical. NaN where the filter has no attitude.
    """
    kept = orientation[::every]
    angles = np.full((len(kept), len(ANGLE_COLUMNS)), np.nan, order='F')
    known = np.isfinite(orientation[:, 0])
    if not known.any():
        return angles
    early = orientation[known & (seconds < seconds[np.argmax(known)] + START_ATTITUDE_S)]
    signs = np.sign(early @ early[0])[:, None]
    start = conjugate(normalised((early * np.where(signs == 0, 1.0, signs)).mean(axis=0)))
    rows = np.flatnonzero(known[::every])
    for begin in range(0, len(rows), CHUNK_ROWS):
        part = rows[begin : begin + CHUNK_ROWS]
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


LEAST_FILTER_RATE_HZ = 50.0
"""Slowest rate [Hz] of recordings that a verdict on the filters rests on."""
INTERPOLATED_RATE_HZ = 25.0
"""Rate [Hz] slower recordings are interpolated to: what lies between their samples is a straight
line, and spreads of the degrees differ from those at 50 Hz by 3 % at most."""
UNFILTERED_TRACKS = tuple(name for name in OPTIONAL_FIELDS if name != 'cycle')
"""Tracks the filters do not look at."""
ALL_RUNS_POINTS = 4_000
"""Points per line of all recordings together."""


@dataclass(frozen=True, eq=False)
class AttitudeTask:
    """One recording to be run through the filters, raw and compensated."""

    recording: ImuRecording
    model: ThermalModel | None
    among: int
    """Number of recordings whose lines share a page."""

    @property
    def label(self) -> str:
        """What is filtered."""
        return f'filtering {self.recording.run}'

    @property
    def size(self) -> float:
        """Rows to be filtered and looked at [10⁶]."""
        seconds = float(self.recording.time[-1]) if len(self.recording) else 0.0
        rows = (
            INTERPOLATED_RATE_HZ * seconds
            if is_slow(self.recording)
            else 3.0 * len(self.recording)
        )
        return rows * 1e-6

    def run(self) -> tuple[FilterAttitude, ...]:
        """Return the attitudes; none without a model."""
        first = startup_rows(self.recording)[0]
        if self.model is None or len(self.recording) - first < 2:
            return ()
        slow = is_slow(self.recording)
        raw = self.recording.rows(slice(first, None)) if first else self.recording
        found = estimate_attitudes(
            variants(raw, self.model),
            every=round(INTERPOLATED_RATE_HZ) if slow else stride_of(raw),
            points=int(np.clip(ALL_RUNS_POINTS / self.among, 250, 1000)),
        )
        return tuple(found)


def variants(raw: ImuRecording, model: ThermalModel) -> dict[str, ImuRecording]:
    """Return the inputs of the filters: raw, and compensated by every version of the model.

    A recording fast enough for a verdict is also taken with only its magnetometer compensated.
    """
    found = {RAW: without_tracks(raw)}
    for number, version in enumerate(model.history, 1):
        found[f'version {number}'] = without_tracks(compensate(raw, version))
    full = without_tracks(compensate(raw, model))
    if is_slow(raw):
        found[FULL] = full
        return {
            name: upsample(recording, INTERPOLATED_RATE_HZ) for name, recording in found.items()
        }
    if np.isfinite(raw.magnetic_field).any():
        found[MAGNETOMETER_ONLY] = replace(found[RAW], magnetic_field=full.magnetic_field)
    return found | {FULL: full}


def without_tracks(recording: ImuRecording) -> ImuRecording:
    """Return the recording with what filters need and the cycle: a third of the memory."""
    absent: dict[str, Any] = dict.fromkeys(UNFILTERED_TRACKS)
    return replace(recording, **absent)


def stride_of(recording: ImuRecording) -> int:
    """Return every how many rows the angles of a fast recording are taken."""
    return max(round(sample_rate(recording) / INTERPOLATED_RATE_HZ), 1)


def is_slow(recording: ImuRecording) -> bool:
    """Tell whether the recording has to be interpolated for the filters."""
    return not sample_rate(recording) >= 0.98 * LEAST_FILTER_RATE_HZ


def after_startup(recording: ImuRecording) -> NDArray[np.bool_]:
    """Return (n,) the rows after the start-up transient."""
    kept = np.ones(len(recording), dtype=bool)
    kept[: startup_rows(recording)[0]] = False
    return kept
