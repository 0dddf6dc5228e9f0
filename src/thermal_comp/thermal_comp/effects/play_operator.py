# SPDX-License-Identifier: Apache-2.0
"""The play (backlash) operator, building stone of Prandtl-Ishlinskii hysteresis."""

from __future__ import annotations

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray


def play(
    values: FloatArray, half_width: float, state: float | None = None
) -> tuple[FloatArray, float | None]:
    """Return the play of the values (n,) and its last value; without a state it starts centred.

    p_i = min(u_i + r, max(u_i − r, p_{i−1})) for half-width r.

    >>> play(np.array([0.0, 3.0, 2.0, -3.0]), 1.0)
    (array([ 0.,  2.,  2., -2.]), -2.0)
    """
    if not len(values):
        return np.empty(0), state
    start = float(values[0]) if state is None else state
    played = _play(values, half_width, start)
    return played, float(played[-1])


@njit(cache=True)
def _play(values: FloatArray, half_width: float, output: float) -> FloatArray:
    played = np.empty(len(values))
    for i in range(len(values)):
        output = min(values[i] + half_width, max(values[i] - half_width, output))
        played[i] = output
    return played
