# SPDX-License-Identifier: Apache-2.0
"""The unknown thermal state after a gap in a recording, as decays fitted beside the level."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray

SHORTEST_GAP_S = 120.0
"""Gap from which its temperatures count as unknown [s] …"""
SHORTEST_GAP_ROWS = 5.0
"""… and the same in usual distances of rows: what is sampled slowly has none."""
MEMORY_S = (60.0, 300.0, 1500.0)
"""Time constants of what is remembered [s]: between them lies an exponential of any from 30 s to
an hour."""
FORGOTTEN = 7.0
"""Time constants after which nothing is left: a thousandth."""
SHORTEST_STRETCH_S, SHORTEST_STRETCH_ROWS = 1200.0, 60.0
"""What is recorded from gap to gap on average, in seconds and in rows, below which nothing would
be left to learn from, as in bursts."""


def decays_after_gaps(time: FloatArray) -> FloatArray:
    """Return (n, q) decays after each long gap between ascending `time` (n,) [s].

    The state of a first-order lag is off by (T_lag − T̂_lag) exp(−(t − t₀) / τ) from the end t₀ of
    a gap on, whatever the temperature did in it: the homogeneous solution of its equation. q is 0
    where there is no long gap, or where there are too many of them.
    """
    steps = np.diff(time)
    usual = float(np.median(steps)) if len(steps) else 0.0
    ends = time[1:][steps > max(SHORTEST_GAP_S, SHORTEST_GAP_ROWS * usual)]
    stretch = max(SHORTEST_STRETCH_S, SHORTEST_STRETCH_ROWS * usual)
    if len(ends) * stretch > len(time) * usual:
        ends = ends[:0]
    since = time[:, None] - ends
    decays = [
        np.where((since >= 0.0) & (since < FORGOTTEN * seconds), np.exp(-since / seconds), 0.0)
        for seconds in MEMORY_S
    ]
    return np.concatenate(decays, axis=1)
