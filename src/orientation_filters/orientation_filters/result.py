# SPDX-License-Identifier: Apache-2.0
"""Result of a filter over a recording: one row per row, and the flags of each row.

>>> names(SIX_AXIS | AT_REST)
('six_axis', 'at_rest')
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray

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
    REINITIALISED: ('reinitialised', 'attitude set anew: start, gap, or first heading'),
    JUMPED_BACK: ('jumped_back', 'time jumped back (a bag looped): everything was forgotten'),
    SIX_AXIS: ('six_axis', 'heading from the gyroscope: no magnetometer sample for too long'),
    DISTURBED: ('disturbed', 'magnetometer rejected: field unlike the reference'),
    JAMMED: ('jammed', 'magnetic disturbance larger than twice the field: magnetometer ignored'),
    AT_REST: ('at_rest', 'no motion: the gyroscope shows its bias'),
    BIAS_LIMITED: ('bias_limited', 'at rest with a rate above the bias limit: not learned'),
    INVALID_GYROSCOPE: ('invalid_gyroscope', 'angular velocity not finite or absurd: ignored'),
    INVALID_ACCELEROMETER: ('invalid_accelerometer', 'specific force zero, not finite or absurd'),
    INVALID_MAGNETOMETER: ('invalid_magnetometer', 'magnetic field zero, not finite or absurd'),
}
"""Bit → name and meaning."""


def names(flags: int) -> tuple[str, ...]:
    """Return the names of the bits that are set."""
    return tuple(name for bit, (name, _) in FLAGS.items() if flags & bit)


def counts(flags: NDArray[np.integer]) -> dict[str, int]:
    """Return in how many rows each flag is set, flags that never are left out."""
    count = {name: int(np.count_nonzero(flags & bit)) for bit, (name, _) in FLAGS.items()}
    return {name: number for name, number in count.items() if number}


@dataclass(frozen=True, eq=False)
class OrientationResult:
    """Row i belongs to stamp[i]; NaN before the filter has an attitude."""

    stamp: IntArray
    """(n,) ROS time [ns]."""
    orientation: FloatArray
    """(n, 4) quaternion xyzw, sensor (or body) → world."""
    spread: FloatArray
    """(n, 6) xx, xy, xz, yy, yz, zz of the orientation error about the world's axes [rad²], or
    (n, 2) its inclination and heading where that is all there is."""
    bias: FloatArray
    """(n, 3) of the gyroscope [rad/s], sensor frame."""
    flags: NDArray[np.int32]
    """(n,) bits of `flags`."""
    linear_acceleration: FloatArray | None = None
    """(n, 3) estimated acceleration without gravity [m/s²], sensor frame; AHRS, on request."""
    magnetic_disturbance: FloatArray | None = None
    """(n, 3) estimated disturbance [T], sensor frame; AHRS, on request."""
    inclination: FloatArray | None = None
    """(n,) estimated dip of the field, downward positive [rad]; AHRS, on request."""

    @property
    def packed_covariance(self) -> FloatArray:
        """(n, 6) xx, xy, xz, yy, yz, zz of the orientation error about the world's axes [rad²]."""
        if self.spread.shape[1] == 6:
            return self.spread
        packed = np.zeros((len(self.spread), 6))
        packed[:, [0, 3]] = self.spread[:, :1]
        packed[:, 5] = self.spread[:, 1]
        packed[np.isnan(self.spread[:, 0])] = np.nan
        return packed

    @property
    def covariance(self) -> FloatArray:
        """(n, 3, 3) of the orientation error about the world's axes [rad²]."""
        full: FloatArray = self.packed_covariance[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
        return full


def empty_result(
    stamp: IntArray, *, covariances: int = 6, details: bool = False
) -> OrientationResult:
    """Return a result whose columns are still to be written; bias and flags start as zero."""
    n = len(stamp)
    return OrientationResult(
        stamp,
        np.empty((n, 4)),
        np.empty((n, covariances)),
        np.zeros((n, 3)),
        np.zeros(n, dtype=np.int32),
        np.empty((n, 3)) if details else None,
        np.empty((n, 3)) if details else None,
        np.empty(n) if details else None,
    )
