# SPDX-License-Identifier: Apache-2.0
"""Checks of a sample before a filter uses it: time order, finite values, plausible magnitudes."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording, IntArray

from orientation_filters.kernel import inline
from orientation_filters.result import (
    DROPPED,
    INVALID_ACCELEROMETER,
    INVALID_GYROSCOPE,
    INVALID_MAGNETOMETER,
    JUMPED_BACK,
    REINITIALISED,
)
from orientation_filters.rotation.scalars import Vector, absent, dot

RATE_LIMIT = 1e3
"""Largest angular velocity taken for a measurement [rad/s]."""
FORCE_LIMIT = 1e5
"""Largest specific force taken for a measurement [m/s²]."""
FIELD_LIMIT = 1.0
"""Largest magnetic field taken for a measurement [T]."""


@inline
def check_sample(w: Vector, f: Vector, m: Vector) -> int:
    """Return INVALID_… and DROPPED bits; a field of NaN only is no sample, not an invalid one."""
    flags = 0
    if not dot(w, w) <= RATE_LIMIT * RATE_LIMIT:  # not, so that NaN is refused as well
        flags |= INVALID_GYROSCOPE | DROPPED
    if not 1e-12 <= dot(f, f) <= FORCE_LIMIT * FORCE_LIMIT:
        flags |= INVALID_ACCELEROMETER
    if not is_field(m) and not absent(m):
        flags |= INVALID_MAGNETOMETER
    return flags


@inline
def is_field(m: Vector) -> bool:
    """Whether the vector can be a magnetic field [T]: neither zero, nor NaN, nor absurd."""
    return 1e-20 <= dot(m, m) <= FIELD_LIMIT * FIELD_LIMIT


@inline
def check_time(stamp: int, last: int, max_gap: int) -> int:
    """Return DROPPED, REINITIALISED, JUMPED_BACK bits for a stamp after `last` [ns] (−1: none)."""
    if last < 0:
        return REINITIALISED
    step = stamp - last
    if step > max_gap:
        return REINITIALISED
    if step < -max_gap:
        return REINITIALISED | JUMPED_BACK
    if step <= 0:
        return DROPPED
    return 0


def columns(
    recording: ImuRecording,
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Return stamp, angular velocity, specific force and field as kernels are compiled for.

    They are contiguous and read-only, wherever the recording has them from: one compiled version.
    """
    names = ('angular_velocity', 'linear_acceleration', 'magnetic_field')
    stamp = _readable(recording.stamp, np.int64)
    w, f, m = (_readable(getattr(recording, name), np.float64) for name in names)
    return stamp, w, f, m


def _readable(column: np.ndarray, dtype: type) -> np.ndarray:
    view: np.ndarray = np.ascontiguousarray(column, dtype=dtype).view()
    view.flags.writeable = False
    return view
