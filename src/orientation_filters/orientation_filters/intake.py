# SPDX-License-Identifier: Apache-2.0
"""Whether a filter may use a sample: its time, and whether its numbers are numbers."""

from __future__ import annotations

from orientation_filters.flags import (
    DROPPED,
    INVALID_ACCELEROMETER,
    INVALID_GYROSCOPE,
    INVALID_MAGNETOMETER,
    JUMPED_BACK,
    REINITIALISED,
)
from orientation_filters.kernel import kernel
from orientation_filters.quaternion import Vector, absent, dot, usable

RATE_LIMIT = 1e3
"""Largest angular velocity taken for a measurement [rad/s]."""
FORCE_LIMIT = 1e5
"""Largest specific force taken for a measurement [m/s²]."""
FIELD_LIMIT = 1.0
"""Largest magnetic field taken for a measurement [T]."""


@kernel
def check_sample(w: Vector, f: Vector, m: Vector) -> int:
    """Return INVALID_… and DROPPED bits; a field of NaN only is no sample, not an invalid one."""
    flags = 0
    if not usable(w, RATE_LIMIT):
        flags |= INVALID_GYROSCOPE | DROPPED
    if not usable(f, FORCE_LIMIT) or dot(f, f) < 1e-12:
        flags |= INVALID_ACCELEROMETER
    if not absent(m) and (not usable(m, FIELD_LIMIT) or dot(m, m) < 1e-20):
        flags |= INVALID_MAGNETOMETER
    return flags


@kernel
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
