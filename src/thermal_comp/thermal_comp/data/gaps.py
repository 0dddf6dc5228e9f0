# SPDX-License-Identifier: Apache-2.0
"""Long gaps of a recording, in which nobody measured the temperature, and what is left of them."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray

SHORTEST_GAP_S = 120.0
"""Length of a gap from which the temperatures in it count as unknown [s]."""
SHORTEST_GAP_ROWS = 5.0
"""The same in usual distances of rows: rows that are far apart are no gaps."""
DECAY_TIMES_S = (60.0, 300.0, 1500.0)
"""Time constants of the decays after a gap [s]: sums of them follow any exponential between 30 s
and an hour."""
DECAY_LENGTH = 7.0
"""Time constants after which a decay is cut: a thousandth of it is left."""
SHORTEST_STRETCH_S, SHORTEST_STRETCH_ROWS = 1200.0, 60.0
"""Mean length of what is recorded between gaps, in seconds and in rows, below which gaps are left
alone: in bursts their decays would leave nothing to learn from."""


def ends_of_long_gaps(time: FloatArray) -> FloatArray:
    """Return the ends of long gaps between ascending `time` (n,) [s]; () where they are many."""
    steps = np.diff(time)
    usual = float(np.median(steps)) if len(steps) else 0.0
    ends = time[1:][steps > max(SHORTEST_GAP_S, SHORTEST_GAP_ROWS * usual)]
    stretch = max(SHORTEST_STRETCH_S, SHORTEST_STRETCH_ROWS * usual)
    return ends[:0] if len(ends) * stretch > len(time) * usual else ends


def decays_after_gaps(time: FloatArray) -> FloatArray:
    """Return (n, q) decays after each long gap between ascending `time` (n,) [s].

    The state of a first-order lag is off by (T_lag − T̂_lag) exp(−(t − t₀) / τ) from the end t₀ of
    a gap on, whatever the temperature did in it: the homogeneous solution of its equation.
    """
    since = time[:, None] - ends_of_long_gaps(time)
    decays = [
        np.where(
            (since >= 0.0) & (since < DECAY_LENGTH * seconds),
            np.exp(-np.maximum(since, 0.0) / seconds),
            0.0,
        )
        for seconds in DECAY_TIMES_S
    ]
    return np.concatenate(decays, axis=1)
