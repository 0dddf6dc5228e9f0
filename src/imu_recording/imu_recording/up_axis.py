# SPDX-License-Identifier: Apache-2.0
"""Which sensor axis points up, told by gravity."""

from __future__ import annotations

import numpy as np

from imu_recording.recording import UP_AXES, FloatArray

GRAVITY = 9.80665
"""Standard gravity [m/s²], ISO 80000-3."""
DOMINANT = 0.9
"""The axis must carry at least this share of the specific force, in most of the recording."""


def infer_up_axis(linear_acceleration: FloatArray) -> str:
    """Return the entry of UP_AXES that carries gravity throughout, or '' where none does.

    `linear_acceleration` (n, 3) [m/s²] is specific force: +g on the axis pointing up (REP-145).

    >>> infer_up_axis(np.array([[0.1, -9.8, 0.2]] * 5))
    '-y'
    """
    sample = linear_acceleration[:: max(1, len(linear_acceleration) // 20_000)]
    sample = sample[np.isfinite(sample).all(axis=1)]
    if not len(sample):
        return ''
    with np.errstate(over='ignore'):  # numbers no accelerometer gives make no axis point up
        norm = np.linalg.norm(sample, axis=1)
    if not 0.5 * GRAVITY < float(np.median(norm)) < 1.5 * GRAVITY:
        return ''
    middle = np.median(sample, axis=0)
    axis = int(np.argmax(np.abs(middle)))
    sign = np.sign(middle[axis])
    share = np.mean(sign * sample[:, axis] > DOMINANT * norm)
    if share < DOMINANT:
        return ''
    return UP_AXES[2 * axis + int(sign < 0)]
