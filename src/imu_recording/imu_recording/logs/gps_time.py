# SPDX-License-Identifier: Apache-2.0
"""The date at which the clock of a log was zero, from the times its GPS receiver told."""

from __future__ import annotations

from typing import Any

import numpy as np

from imu_recording.recording import FloatArray, IntArray

GPS_EPOCH_S = 315_964_800
"""1980-01-06 in Unix time."""
WEEK_S = 604_800
LEAP_SECONDS = 18
"""Seconds by which GPS time is ahead of UTC, since 2017."""
POSITION_FIX_STATUS = 3
"""Status of a receiver from which its time is right (three-dimensional fix)."""
POSSIBLE_DATES_S = (1.2e9, 4.1e9)
"""Dates that are used: 2008 to 2099, Unix time."""
LARGEST_SPREAD_S = 2.0
"""Largest scatter of a receiver's times about those of the log; more is not used [s]."""


def unix_of_gps(week: Any, milliseconds: Any) -> FloatArray:
    """Return Unix times [s] of GPS weeks and milliseconds within them.

    >>> float(unix_of_gps(2000, 0)) - 1_525_564_782
    0.0
    """
    weeks = np.asarray(week, np.float64) * WEEK_S
    return np.asarray(
        GPS_EPOCH_S - LEAP_SECONDS + weeks + 1e-3 * np.asarray(milliseconds, np.float64)
    )


def power_on(time: IntArray, unix: FloatArray, fix: Any) -> int | None:
    """Return when a log's clock was zero, Unix time [ns]; None where no receiver tells.

    `time`: (n,) of the log [ns], `unix`: (n,) told by the receiver then [s], `fix`: (n,) status.
    """
    usable = (
        (np.asarray(fix) >= POSITION_FIX_STATUS)
        & (unix > POSSIBLE_DATES_S[0])
        & (unix < POSSIBLE_DATES_S[1])
    )
    if not usable.any():
        return None
    zero = unix[usable] - time[usable] * 1e-9
    middle = float(np.median(zero))
    if float(np.median(np.abs(zero - middle))) > LARGEST_SPREAD_S:
        return None
    return round(middle * 1e6) * 1000
