# SPDX-License-Identifier: Apache-2.0
"""Slow recordings for filters that need a fast one: measured columns joined by straight lines."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording, IntArray
from numpy.typing import NDArray

LINES = ('angular_velocity', 'linear_acceleration', 'magnetic_field', 'temperature')
"""Columns that are interpolated."""
LARGEST_GAP = 3.0
"""Periods between two samples across which nothing is interpolated."""


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
    first, last = int(recording.stamp[0]), int(recording.stamp[-1])
    rows = int((last - first) * 1e-9 * rate_hz) + 1
    stamp = first + np.round(np.arange(rows) * (1e9 / rate_hz)).astype(np.int64)
    inside = _between(stamp, recording.stamp)
    stamp = stamp if inside.all() else stamp[inside]
    held = recording.rows(np.searchsorted(recording.stamp, stamp, side='right') - 1)
    columns: dict[str, Any] = {
        name: _columns(stamp, recording.stamp, getattr(recording, name)) for name in LINES
    }
    return replace(held, stamp=stamp, **columns).with_notes(
        f'interpolated linearly from {1e9 / period:.3g} Hz to {rate_hz:g} Hz for the filters; '
        'angles say little about fast errors'
    )


def _columns(stamp: IntArray, known: IntArray, values: FloatArray) -> FloatArray:
    """Return values (n, …) at the stamps, NaN where finite samples are too far apart."""
    table = values.reshape(len(values), -1)
    finite = np.isfinite(table).all(axis=1)
    if finite.sum() < 2:
        return np.full((len(stamp), *values.shape[1:]), np.nan)
    seconds = (stamp - stamp[0]) * 1e-9
    at = (known[finite] - stamp[0]) * 1e-9
    lines = np.column_stack([np.interp(seconds, at, column) for column in table[finite].T])
    if not finite.all():
        lines[~_between(stamp, known[finite])] = np.nan
    return lines.reshape(len(stamp), *values.shape[1:])


def _between(stamp: IntArray, known: IntArray) -> NDArray[np.bool_]:
    """Return which stamps lie on a known one or between two at most three periods apart."""
    inside: NDArray[np.bool_] = (stamp >= known[0]) & (stamp <= known[-1])
    gap = np.diff(known)
    for hole in np.flatnonzero(gap > LARGEST_GAP * float(np.median(gap))):
        inside &= (stamp <= known[hole]) | (stamp >= known[hole + 1])
    return inside
