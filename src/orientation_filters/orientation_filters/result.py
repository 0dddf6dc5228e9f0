# SPDX-License-Identifier: Apache-2.0
"""Result of a filter over a recording, one row for each of its rows, and the flags of a row.

>>> flag_names(SIX_AXIS | AT_REST)
('six_axis', 'at_rest')
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray

from orientation_filters.rotation.scalars import Quaternion, Symmetric

NOT_STARTED = 1
DROPPED = 2
REINITIALISED = 4
JUMPED_BACK = 8
SIX_AXIS = 16
DISTURBED = 32
JAMMED = 64
AT_REST = 128
BIAS_LIMITED = 256
INVALID_GYROSCOPE = 512
INVALID_ACCELEROMETER = 1024
INVALID_MAGNETOMETER = 2048

FLAGS = {
    NOT_STARTED: ('not_started', 'no attitude yet: no usable specific force so far'),
    DROPPED: ('dropped', 'row not used: stamp not later than the last, or unusable gyroscope'),
    REINITIALISED: (
        'reinitialised',
        'attitude set anew: start, gap, or first magnetometer sample',
    ),
    JUMPED_BACK: (
        'jumped_back',
        'time jumped back (a bag looped): bias and reference field reset',
    ),
    SIX_AXIS: ('six_axis', 'heading from the gyroscope: no magnetometer sample for too long'),
    DISTURBED: ('disturbed', 'magnetometer rejected: field unlike the reference'),
    JAMMED: ('jammed', 'magnetic disturbance larger than twice the field: magnetometer ignored'),
    AT_REST: ('at_rest', 'no motion: the mean angular velocity is the bias'),
    BIAS_LIMITED: ('bias_limited', 'at rest with a rate above bias_limit: not learned as bias'),
    INVALID_GYROSCOPE: ('invalid_gyroscope', 'angular velocity not finite or absurd: ignored'),
    INVALID_ACCELEROMETER: ('invalid_accelerometer', 'specific force zero, not finite or absurd'),
    INVALID_MAGNETOMETER: ('invalid_magnetometer', 'magnetic field zero, not finite or absurd'),
}
"""Bit → name and meaning."""


@lru_cache(maxsize=256)
def flag_names(flags: int) -> tuple[str, ...]:
    """Return the names of the bits that are set."""
    return tuple(name for bit, (name, _) in FLAGS.items() if flags & bit)


def flag_counts(flags: NDArray[np.integer]) -> dict[str, int]:
    """Return the number of rows with each flag that occurs."""
    values, numbers = np.unique(flags[flags != 0], return_counts=True)
    count = {name: int(numbers[values & bit != 0].sum()) for bit, (name, _) in FLAGS.items()}
    return {name: number for name, number in count.items() if number}


class Estimate(NamedTuple):
    """Attitude after a sample; without meaning where flagged NOT_STARTED."""

    orientation: Quaternion
    """xyzw of unit length, w ≥ 0, sensor (or body) → world."""
    covariance: Symmetric
    """xx, xy, xz, yy, yz, zz of the orientation error about the world's axes [rad²]."""
    flags: int


class ResultColumns(NamedTuple):
    """Columns of a result, to be filled by a compiled loop; those not asked for are empty."""

    orientation: FloatArray
    compact_covariance: FloatArray
    bias: FloatArray
    flags: NDArray[np.int32]
    linear_acceleration: FloatArray
    magnetic_disturbance: FloatArray
    inclination: FloatArray


@dataclass(frozen=True, eq=False)
class OrientationResult:
    """Row i belongs to stamp[i]; NaN before the filter has an attitude."""

    stamp: IntArray
    """(n,) ROS time [ns]."""
    orientation: FloatArray
    """(n, 4) quaternion xyzw, sensor (or body) → world."""
    compact_covariance: FloatArray
    """(n, 6) as `packed_covariance`, or (n, 2): variances of inclination and heading [rad²]."""
    bias: FloatArray
    """(n, 3) of the gyroscope [rad/s], sensor frame."""
    flags: NDArray[np.int32]
    """(n,) bits, see `FLAGS`."""
    linear_acceleration: FloatArray | None = None
    """(n, 3) estimated acceleration without gravity [m/s²], sensor frame; AHRS, on request."""
    magnetic_disturbance: FloatArray | None = None
    """(n, 3) estimated disturbance [T], sensor frame; AHRS, on request."""
    inclination: FloatArray | None = None
    """(n,) estimated dip of the field, downward positive [rad]; AHRS, on request."""

    @property
    def packed_covariance(self) -> FloatArray:
        """(n, 6) xx, xy, xz, yy, yz, zz of the orientation error about the world's axes [rad²]."""
        compact = self.compact_covariance
        if compact.shape[1] == 6:
            return compact
        packed = np.zeros((len(compact), 6))
        packed[:, [0, 3]] = compact[:, :1]
        packed[:, 5] = compact[:, 1]
        packed[np.isnan(compact[:, 0])] = np.nan
        return packed

    @property
    def covariance(self) -> FloatArray:
        """(n, 3, 3) of the orientation error about the world's axes [rad²]."""
        full: FloatArray = self.packed_covariance[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
        return full

    def columns(self) -> ResultColumns:
        """Return the columns for a compiled loop to fill."""
        none = np.empty((0, 3))
        return ResultColumns(
            orientation=self.orientation,
            compact_covariance=self.compact_covariance,
            bias=self.bias,
            flags=self.flags,
            linear_acceleration=_or(self.linear_acceleration, none),
            magnetic_disturbance=_or(self.magnetic_disturbance, none),
            inclination=_or(self.inclination, np.empty(0)),
        )


def empty_result(
    stamp: IntArray, *, covariances: int = 6, details: bool = False
) -> OrientationResult:
    """Return a result whose columns are still to be written; bias and flags start as zero."""
    n = len(stamp)
    return OrientationResult(
        stamp=stamp,
        orientation=np.empty((n, 4)),
        compact_covariance=np.empty((n, covariances)),
        bias=np.zeros((n, 3)),
        flags=np.zeros(n, dtype=np.int32),
        linear_acceleration=np.empty((n, 3)) if details else None,
        magnetic_disturbance=np.empty((n, 3)) if details else None,
        inclination=np.empty(n) if details else None,
    )


def _or(column: FloatArray | None, absent: FloatArray) -> FloatArray:
    return absent if column is None else column
