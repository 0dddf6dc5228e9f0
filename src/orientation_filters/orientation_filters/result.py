# SPDX-License-Identifier: Apache-2.0
"""What a filter returns for a recording: columns, one row per row of the recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray


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
