# SPDX-License-Identifier: Apache-2.0
"""Amount of ice on a surface that freezes below 0 °C and melts above."""

from __future__ import annotations

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray

IceState = tuple[float, float]
"""Time of the newest sample [s] and the amount then."""


def grow_and_melt(
    time: FloatArray,
    temperature: FloatArray,
    growth_time: float,
    melt_time: float,
    state: IceState | None = None,
) -> tuple[FloatArray, IceState | None]:
    """Return the amount of ice (n,), 0 … 1, and the state after it; it starts without ice.

    dm/dt = (1 − m) / t_grow while T < 0 °C, −m / t_melt above; T holds since the sample before.
    """
    if not len(time):
        return np.empty(0), state
    last_time, amount = state if state is not None else (float(time[0]), 0.0)
    ice = _grow_and_melt(time, temperature, growth_time, melt_time, last_time, amount)
    return ice, (float(time[-1]), float(ice[-1]))


@njit(cache=True)
def _grow_and_melt(
    time: FloatArray,
    temperature: FloatArray,
    growth_time: float,
    melt_time: float,
    last_time: float,
    amount: float,
) -> FloatArray:
    ice = np.empty(len(time))
    for i in range(len(time)):
        step = time[i] - last_time
        if temperature[i] < 0.0:
            amount = 1.0 - (1.0 - amount) * np.exp(-step / growth_time)
        else:
            amount *= np.exp(-step / melt_time)
        last_time = time[i]
        ice[i] = amount
    return ice
