# SPDX-License-Identifier: Apache-2.0
"""Operators that effects are built of: first-order lag, play, ice, fields fixed in the chamber."""

from __future__ import annotations

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions

LagState = tuple[float, float, float]
"""Time [s], input and output at the newest sample."""


def follow(
    time: FloatArray,
    values: FloatArray,
    time_constant: float,
    state: LagState | None = None,
    *,
    held: bool = False,
) -> tuple[FloatArray, LagState | None]:
    """Return the lagged values (n,) and the state after them; without a state it starts settled.

    y₁ = u₁ − s τ + (y₀ − u₀ + s τ) e^{−Δt/τ},  s = (u₁ − u₀) / Δt: the input is linear between
    samples. `held`: it has its new value since the sample before, y₁ = u₁ + (y₀ − u₁) e^{−Δt/τ}.
    """
    if not len(values):
        return np.empty(0), state
    if state is None:
        state = (float(time[0]), float(values[0]), float(values[0]))
    lagged = _follow(time, values, time_constant, *state, held)
    return lagged, (float(time[-1]), float(values[-1]), float(lagged[-1]))


@njit(cache=True)
def _follow(
    time: FloatArray,
    values: FloatArray,
    time_constant: float,
    last_time: float,
    last_input: float,
    output: float,
    held: bool,
) -> FloatArray:
    lagged = np.empty(len(values))
    for i in range(len(values)):
        step = time[i] - last_time
        if step > 0.0:
            before = values[i] if held else last_input
            lead = (values[i] - before) / step * time_constant
            output = values[i] - lead + (output - before + lead) * np.exp(-step / time_constant)
        last_time = time[i]
        last_input = values[i]
        lagged[i] = output
    return lagged


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


def rise(time: FloatArray, start: float, duration: float) -> FloatArray:
    """Return (n,) what rises evenly from 0 to 1 within `duration` [s] from `start` on.

    >>> rise(np.array([0.0, 2.0, 3.0, 9.0]), 2.0, 4.0)
    array([0.  , 0.  , 0.25, 1.  ])
    >>> rise(np.array([0.0, 2.0, 3.0]), 2.0, 0.0)
    array([0., 1., 1.])
    """
    if duration == 0.0:
        return (time >= start).astype(float)
    return np.clip((time - start) / duration, 0.0, 1.0)


IntegralState = tuple[float, float, float]
"""Time [s], value and integral at the newest sample."""


def time_integral(
    time: FloatArray, values: FloatArray, state: IntegralState | None = None
) -> tuple[FloatArray, IntegralState | None]:
    """Return the integral of the values over time (n,) and the state after them (trapezia).

    It starts at zero. That of the temperature is the phase of a frequency that follows it.

    >>> time_integral(np.array([0.0, 2.0, 3.0]), np.array([1.0, 3.0, 3.0]))[0]
    array([0., 4., 7.])
    """
    if not len(values):
        return np.empty(0), state
    start, first, total = state or (float(time[0]), float(values[0]), 0.0)
    steps = np.diff(time, prepend=start)
    middle = 0.5 * (values + np.concatenate([[first], values[:-1]]))
    integral: FloatArray = total + np.cumsum(middle * steps)
    return integral, (float(time[-1]), float(values[-1]), float(integral[-1]))


IceState = tuple[float, float]
"""Time of the newest sample [s] and the amount then."""


def grow_and_melt(
    time: FloatArray,
    temperature: FloatArray,
    growth_time: float,
    melt_time: float,
    state: IceState | None = None,
    *,
    by_degrees: bool = False,
) -> tuple[FloatArray, IceState | None]:
    """Return the amount of ice (n,), 0 … 1, and the state after it; it starts without ice.

    dm/dt = (1 − m) / t_grow while T < 0 °C, −m / t_melt above; `by_degrees`: −T / (10 K · t_grow)
    below until all water is frozen, −T / (10 K · t_melt) above until all ice is molten. T holds
    since the sample before.
    """
    if not len(time):
        return np.empty(0), state
    last_time, amount = state if state is not None else (float(time[0]), 0.0)
    times = (growth_time, melt_time)
    ice = _grow_and_melt(time, temperature, *times, last_time, amount, by_degrees)
    return ice, (float(time[-1]), float(ice[-1]))


@njit(cache=True)
def _grow_and_melt(
    time: FloatArray,
    temperature: FloatArray,
    growth_time: float,
    melt_time: float,
    last_time: float,
    amount: float,
    by_degrees: bool,
) -> FloatArray:
    ice = np.empty(len(time))
    for i in range(len(time)):
        step = time[i] - last_time
        if by_degrees:
            pace = growth_time if temperature[i] < 0.0 else melt_time
            amount = min(max(amount - 0.1 * temperature[i] * step / pace, 0.0), 1.0)
        elif temperature[i] < 0.0:
            amount = 1.0 - (1.0 - amount) * np.exp(-step / growth_time)
        else:
            amount *= np.exp(-step / melt_time)
        last_time = time[i]
        ice[i] = amount
    return ice


def chamber_field(conditions: Conditions, amount: FloatArray) -> FloatArray:
    """Return (n, 3, 3): amount (n,) × unit vector along each chamber axis, in sensor axes."""
    orientation = conditions.orientation
    assert orientation is not None  # noqa: S101 (effects that use it declare the channel)
    columns: FloatArray = amount[:, None, None] * np.asarray(orientation)[None, :, :]
    return columns


def chamber_and_device_field(conditions: Conditions, amount: FloatArray) -> FloatArray:
    """Return (n, 3, 6): amount × unit vector along each chamber axis, then each sensor axis.

    Currents also return through leads and iron that turn with the device.
    """
    fixed = chamber_field(conditions, amount)
    turning = amount[:, None, None] * np.eye(3)[None, :, :]
    return np.concatenate([fixed, turning], axis=2)
