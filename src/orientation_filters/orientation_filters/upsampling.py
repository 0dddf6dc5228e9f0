# SPDX-License-Identifier: Apache-2.0
"""Linear interpolation of slow recordings onto a faster grid, for filters that need one."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
from imu_recording.jit import njit
from imu_recording.logging_contract import MEASURED_FIELDS
from imu_recording.recording import FloatArray, ImuRecording, IntArray
from numpy.typing import NDArray

INTERPOLATED_FIELDS = (*MEASURED_FIELDS, 'temperature')
LARGEST_GAP_PERIODS = 3.0
"""Longest distance of two samples that is interpolated [sample periods]."""


def upsample(recording: ImuRecording, rate_hz: float = 50.0) -> ImuRecording:
    """Return a recording slower than `rate_hz` on a grid of that rate, with a note.

    Angular velocity, specific force, magnetic field and die temperature are interpolated
    linearly; other tracks hold their newest value. Between samples more than three periods apart
    there are no rows (magnetic field: NaN). A recording that is fast enough is returned as it is.
    """
    if len(recording) < 2:
        return recording
    period = float(np.median(np.diff(recording.stamp)))
    if period <= 1.02e9 / rate_hz:
        return recording
    stamp = _grid(recording.stamp, rate_hz)
    newest = newest_rows(stamp, recording.stamp)
    tracks = {
        track.name: values
        for track in fields(recording)
        if isinstance(values := getattr(recording, track.name), np.ndarray)
    }
    columns: dict[str, Any] = {
        name: _columns(stamp, recording.stamp, values)
        if name in INTERPOLATED_FIELDS
        else values[newest]
        for name, values in tracks.items()
    }
    return replace(recording, **columns | {'stamp': stamp}).with_notes(
        f'interpolated linearly from {1e9 / period:.3g} Hz to {rate_hz:g} Hz for the filters; '
        'angles say little about fast errors'
    )


def _grid(known: IntArray, rate_hz: float) -> IntArray:
    """Return stamps of that rate on or between the known ones, gaps left out."""
    first, last = int(known[0]), int(known[-1])
    rows = int((last - first) * 1e-9 * rate_hz) + 1
    stamp = first + np.round(np.arange(rows) * (1e9 / rate_hz)).astype(np.int64)
    inside = _between(stamp, known)
    return stamp if inside.all() else stamp[inside]


def _columns(stamp: IntArray, known: IntArray, values: FloatArray) -> FloatArray:
    """Return values (n, …) at the stamps, NaN where finite samples are too far apart."""
    table = values.reshape(len(values), -1)
    finite = np.isfinite(table).all(axis=1)
    if finite.sum() < 2:
        return np.full((len(stamp), *values.shape[1:]), np.nan)
    lines: FloatArray = interpolated(stamp, known[finite], np.ascontiguousarray(table[finite]))
    if not finite.all():
        lines[~_between(stamp, known[finite])] = np.nan
    return lines.reshape(len(stamp), *values.shape[1:])


@njit
def newest_rows(stamp: IntArray, known: IntArray) -> IntArray:
    """Return (m,) the newest known row at increasing stamps (m,) from the first known one on."""
    newest = np.empty(len(stamp), dtype=np.int64)
    last, j = len(known) - 1, 0
    for i in range(len(stamp)):
        while j < last and known[j + 1] <= stamp[i]:
            j += 1
        newest[i] = j
    return newest


@njit
def interpolated(stamp: IntArray, known: IntArray, values: FloatArray) -> FloatArray:
    """Return values (m, k) at increasing stamps (m,), known at the increasing stamps (n,).

    As `np.interp`, column by column: straight lines, the first and last value beyond the ends.
    """
    lines = np.empty((len(stamp), values.shape[1]))
    slope = np.zeros(values.shape[1])
    last, j, start = len(known) - 1, -1, 0.0
    for i in range(len(stamp)):
        time = (stamp[i] - stamp[0]) * 1e-9
        while j < last and known[j + 1] <= stamp[i]:
            j += 1
            start = (known[j] - stamp[0]) * 1e-9
            span = (known[j + 1] - stamp[0]) * 1e-9 - start if j < last else np.inf
            for k in range(values.shape[1]):  # of whole rows it takes ten times as long to compile
                slope[k] = (values[min(j + 1, last), k] - values[j, k]) / span
        for k in range(values.shape[1]):
            lines[i, k] = slope[k] * (time - start) + values[max(j, 0), k]
    return lines


def _between(stamp: IntArray, known: IntArray) -> NDArray[np.bool_]:
    """Return which stamps lie on a known one or between two at most three periods apart."""
    inside: NDArray[np.bool_] = (stamp >= known[0]) & (stamp <= known[-1])
    gap = np.diff(known)
    for hole in np.flatnonzero(gap > LARGEST_GAP_PERIODS * float(np.median(gap))):
        inside &= (stamp <= known[hole]) | (stamp >= known[hole + 1])
    return inside
