# SPDX-License-Identifier: Apache-2.0
"""One sample of the three sensors, and the checks before a filter uses it.

Checked are the order in time, gaps, finite values and plausible magnitudes.
"""

from __future__ import annotations

from math import nan
from typing import NamedTuple

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording, IntArray

from orientation_filters.kernel import inline
from orientation_filters.result import (
    DROPPED,
    INVALID_ACCELEROMETER,
    INVALID_GYROSCOPE,
    INVALID_MAGNETOMETER,
    JUMPED_BACK,
    NOT_STARTED,
    REINITIALISED,
    SIX_AXIS,
)
from orientation_filters.rotation.scalars import Vector, absent, dot

GRAVITY = 9.81
"""Specific force at rest [m/s²]."""
LARGEST_ANGULAR_VELOCITY = 1e3
"""Larger ones are no measurement [rad/s]."""
LARGEST_SPECIFIC_FORCE = 1e5
"""Larger ones are no measurement [m/s²]."""
LARGEST_FIELD = 1.0
"""Larger ones are no measurement [T]."""
NO_FIELD = (nan, nan, nan)


class Sample(NamedTuple):
    """What the sensors measured at one time, sensor frame."""

    stamp: int
    """[ns]"""
    angular_velocity: Vector
    """[rad/s]"""
    linear_acceleration: Vector
    """Specific force [m/s²]."""
    magnetic_field: Vector
    """[T]; NaN: no sample."""


class SampleParams(NamedTuple):
    """Which samples a filter uses."""

    use_magnetometer: bool
    max_gap: int
    """Longer pauses set the attitude anew [ns]."""
    magnetometer_timeout: int
    """How long a magnetometer sample holds [ns]."""


class CheckedSample(NamedTuple):
    """A sample, which parts of it are usable, and the time since the samples before."""

    stamp: int
    angular_velocity: Vector
    linear_acceleration: Vector
    magnetic_field: Vector
    """NaN where `has_field` is false."""
    has_force: bool
    has_field: bool
    interval: float
    """Since the last sample used [s]."""
    field_interval: float
    """Since the last magnetometer sample [s]."""


class SampleColumns(NamedTuple):
    """Samples as columns, contiguous and read-only: one compiled version of every loop."""

    stamp: IntArray
    angular_velocity: FloatArray
    linear_acceleration: FloatArray
    magnetic_field: FloatArray


@inline
def check_sample(
    sample: Sample, last: int, last_field: int, params: SampleParams
) -> tuple[CheckedSample, int]:
    """Return the checked sample and its flags; `last`, `last_field` [ns], −1 for none.

    A sample flagged DROPPED is not to be used; REINITIALISED: the attitude is to be set anew.
    """
    flags = _check_values(sample) | _check_time(sample.stamp, last, params.max_gap)
    has_field = params.use_magnetometer and is_field(sample.magnetic_field)
    if flags & DROPPED:
        if last < 0:
            flags |= NOT_STARTED
    elif has_field and last_field < 0:
        flags |= REINITIALISED
    elif not has_field and (
        last_field < 0 or sample.stamp - last_field > params.magnetometer_timeout
    ):
        flags |= SIX_AXIS
    checked = CheckedSample(
        stamp=sample.stamp,
        angular_velocity=sample.angular_velocity,
        linear_acceleration=sample.linear_acceleration,
        magnetic_field=sample.magnetic_field if has_field else NO_FIELD,
        has_force=not flags & INVALID_ACCELEROMETER,
        has_field=has_field,
        interval=(sample.stamp - last) * 1e-9,
        field_interval=(sample.stamp - last_field) * 1e-9,
    )
    return checked, flags


@inline
def _check_values(sample: Sample) -> int:
    """Return INVALID_… and DROPPED bits; a field of NaN only is absent, not invalid."""
    w, f, m = sample.angular_velocity, sample.linear_acceleration, sample.magnetic_field
    flags = 0
    if not dot(w, w) <= LARGEST_ANGULAR_VELOCITY**2:  # not, so that NaN is refused as well
        flags |= INVALID_GYROSCOPE | DROPPED
    if not 1e-12 <= dot(f, f) <= LARGEST_SPECIFIC_FORCE**2:
        flags |= INVALID_ACCELEROMETER
    if not is_field(m) and not absent(m):
        flags |= INVALID_MAGNETOMETER
    return flags


@inline
def is_field(m: Vector) -> bool:
    """Whether the vector can be a magnetic field [T]: neither zero, nor NaN, nor absurd."""
    return 1e-20 <= dot(m, m) <= LARGEST_FIELD**2


@inline
def _check_time(stamp: int, last: int, max_gap: int) -> int:
    """Return DROPPED, REINITIALISED, JUMPED_BACK bits for a stamp after `last` [ns]."""
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


@inline
def sample_of(columns: SampleColumns, i: int) -> Sample:
    """Return row i of the columns."""
    w, f, m = columns.angular_velocity, columns.linear_acceleration, columns.magnetic_field
    return Sample(
        columns.stamp[i],
        (w[i, 0], w[i, 1], w[i, 2]),
        (f[i, 0], f[i, 1], f[i, 2]),
        (m[i, 0], m[i, 1], m[i, 2]),
    )


def sample_columns(recording: ImuRecording) -> SampleColumns:
    """Return the columns of a recording as kernels are compiled for."""
    return SampleColumns(
        stamp=_read_only(recording.stamp, np.int64),
        angular_velocity=_read_only(recording.angular_velocity, np.float64),
        linear_acceleration=_read_only(recording.linear_acceleration, np.float64),
        magnetic_field=_read_only(recording.magnetic_field, np.float64),
    )


def _read_only(column: np.ndarray, dtype: type) -> np.ndarray:
    view: np.ndarray = np.ascontiguousarray(column, dtype=dtype).view()
    view.flags.writeable = False
    return view
