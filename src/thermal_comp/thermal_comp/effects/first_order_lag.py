# SPDX-License-Identifier: Apache-2.0
"""First-order lag of a sampled quantity, exact for input that is linear between samples."""

from __future__ import annotations

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray

LagState = tuple[float, float, float]
"""Time [s], input and output at the newest sample."""


def follow(
    time: FloatArray, values: FloatArray, time_constant: float, state: LagState | None = None
) -> tuple[FloatArray, LagState | None]:
    """Return the lagged values (n,) and the state after them; without a state it starts settled.

    y₁ = u₁ − s τ + (y₀ − u₀ + s τ) e^{−Δt/τ},  s = (u₁ − u₀) / Δt.
    """
    if not len(values):
        return np.empty(0), state
    if state is None:
        state = (float(time[0]), float(values[0]), float(values[0]))
    lagged = _follow(time, values, time_constant, state[0], state[1], state[2])
    return lagged, (float(time[-1]), float(values[-1]), float(lagged[-1]))


@njit(cache=True)
def _follow(
    time: FloatArray,
    values: FloatArray,
    time_constant: float,
    last_time: float,
    last_input: float,
    output: float,
) -> FloatArray:
    lagged = np.empty(len(values))
    for i in range(len(values)):
        step = time[i] - last_time
        if step > 0.0:
            lead = (values[i] - last_input) / step * time_constant
            output = (
                values[i] - lead + (output - last_input + lead) * np.exp(-step / time_constant)
            )
        last_time = time[i]
        last_input = values[i]
        lagged[i] = output
    return lagged
