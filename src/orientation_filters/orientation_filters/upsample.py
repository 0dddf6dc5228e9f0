# SPDX-License-Identifier: Apache-2.0
"""Slow recordings for filters that need a fast one: measured columns joined by straight lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording, IntArray
from numpy.typing import NDArray

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
    stamp = stamp[_between(stamp, recording.stamp, LARGEST_GAP * period)]
    held = recording.rows(np.searchsorted(recording.stamp, stamp, side='right') - 1)
    return replace(
        held,
        stamp=stamp,
        angular_velocity=_columns(stamp, recording.stamp, recording.angular_velocity),
        linear_acceleration=_columns(stamp, recording.stamp, recording.linear_acceleration),
        magnetic_field=_columns(stamp, recording.stamp, recording.magnetic_field),
        temperature=_columns(stamp, recording.stamp, recording.temperature[:, None])[:, 0],
    ).with_notes(
        f'interpolated linearly from {1e9 / period:.3g} Hz to {rate_hz:g} Hz for the filters; '
        'angles say little about fast errors'
    )


def _columns(stamp: IntArray, known_stamp: IntArray, values: FloatArray) -> FloatArray:
    """Return values (n, k) at the stamps, NaN where finite samples are too far apart."""
    finite = np.isfinite(values).all(axis=1)
    result = np.full((len(stamp), values.shape[1]), np.nan)
    known_stamp, values = known_stamp[finite], values[finite]
    if len(known_stamp) < 2:
        return result
    gap = LARGEST_GAP * float(np.median(np.diff(known_stamp)))
    inside = _between(stamp, known_stamp, gap)
    seconds = (stamp[inside] - known_stamp[0]) * 1e-9
    known = (known_stamp - known_stamp[0]) * 1e-9
    for column in range(values.shape[1]):
        result[inside, column] = np.interp(seconds, known, values[:, column])
    return result


def _between(stamp: IntArray, known: IntArray, gap: float) -> NDArray[np.bool_]:
    """Return which stamps lie on a known one or between two at most `gap` apart."""
    after = np.searchsorted(known, stamp, side='left')
    inside = after < len(known)
    on = np.zeros(len(stamp), dtype=bool)
    on[inside] = known[after[inside]] == stamp[inside]
    near = inside & (after > 0)
    near[near] = known[after[near]] - known[after[near] - 1] <= gap
    return on | near
