# SPDX-License-Identifier: Apache-2.0
"""How far specific force and field turn the complementary filter's attitude, and its errors.

`adaptive` is a constant where it is False, which leaves its half out when compiled.
"""

from __future__ import annotations

from math import exp, sqrt

from orientation_filters.complementary_state import Params, State
from orientation_filters.flags import DISTURBED, INVALID_ACCELEROMETER, SIX_AXIS
from orientation_filters.kernel import inline
from orientation_filters.magnetic_reference import FieldState, judge_field
from orientation_filters.quaternion import (
    Matrix,
    Quaternion,
    Vector,
    dot,
    multiply,
    scale,
    transform,
)

PER_GRAVITY = 1.0 / 9.81


@inline
def correct_inclination(
    state: State,
    params: Params,
    rows: Matrix,
    f: Vector,
    dt: float,
    flags: int,
    adaptive: bool,
) -> tuple[float, float, float, float]:
    """Return x, y of the rotation to specific force upward, gain, the sample's sigma."""
    if flags & INVALID_ACCELEROMETER:
        return 0.0, 0.0, 0.0, 0.0
    gain = _gain(params.inclination_rate, dt, state.age, params, adaptive)
    length = sqrt(dot(f, f))
    if adaptive:  # accelerations average out only where they are not normalised away
        up = transform(rows, scale(params.up * PER_GRAVITY, f))
        x, y = up[1], -up[0]
    else:
        x, y = _inclination_error(transform(rows, scale(1.0 / length, f)), params.up)
    return x, y, gain, params.inclination_sigma + abs(length * PER_GRAVITY - 1.0)


@inline
def correct_heading(
    state: State,
    params: Params,
    seen: Vector,
    stamp: int,
    rate: Vector,
    has_field: bool,
    known_gain: tuple[float, float],
    adaptive: bool,
) -> tuple[float, float, FieldState, int]:
    """Return z of the rotation of the field `seen` to magnetic north, gain, field and flags.

    `known_gain` is a time step [s] and the accelerometer's gain for it.
    """
    since = (stamp - state.field_stamp) * 1e-9
    field = state.field
    if not has_field:
        late = state.field_stamp < 0 or stamp - state.field_stamp > params.magnetometer_timeout
        return 0.0, 0.0, field, SIX_AXIS if late else 0
    level = sqrt(seen[0] * seen[0] + seen[1] * seen[1])
    if adaptive:
        parts = (level, -params.up * seen[2])
        field = judge_field(field, params.field, parts, sqrt(dot(rate, rate)), since)
        if field.accepted_for < params.field.hold:
            return 0.0, 0.0, field, DISTURBED
    if level <= 1e-3 * abs(seen[2]):
        return 0.0, 0.0, field, 0
    gain = known_gain[1]
    if adaptive or since != known_gain[0] or params.heading_rate != params.inclination_rate:
        gain = _gain(params.heading_rate, since, state.age, params, adaptive)
    return _heading_error(seen, level, params.north), gain, field, 0


@inline
def turn(q: Quaternion, error: Vector, tilt: float, spin: float, square: float) -> Quaternion:
    """Return q turned in the world by its part of `error`, rescaled by the length² it had before.

    Rescaling by what is known already keeps square root and division out of the way of the next
    sample; the length stays within the square of half a correction of 1.
    """
    factor = 1.5 - 0.5 * square
    tilt, spin = 0.5 * factor * tilt, 0.5 * factor * spin
    return multiply((tilt * error[0], tilt * error[1], spin * error[2], factor), q)


@inline
def spread_errors(
    state: State, params: Params, dt: float, gain: tuple[float, float], tilt_sigma: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the variances from noise and the errors from a bias, inclination and heading."""
    walk = params.angle_random_walk * params.angle_random_walk * dt
    drift = params.bias_sigma * dt
    variance = (
        _filtered(state.variance[0] + walk, gain[0], tilt_sigma),
        _filtered(state.variance[1] + walk, gain[1], params.heading_sigma),
    )
    lag = ((1.0 - gain[0]) * (state.lag[0] + drift), (1.0 - gain[1]) * (state.lag[1] + drift))
    return variance, lag


@inline
def _inclination_error(up: Vector, sign: float) -> tuple[float, float]:
    """Return x, y of the rotation vector that turns `up` to the vertical: its sine, at most 1."""
    x, y = up[1] * sign, -up[0] * sign
    if up[2] * sign < 0.0:  # beyond 90° the sine falls again; the correction must not
        length = sqrt(x * x + y * y)
        return (x / length, y / length) if length > 1e-6 else (1.0, 0.0)
    return x, y


@inline
def _heading_error(seen: Vector, level: float, north: tuple[float, float]) -> float:
    """Return the sine of the angle from the horizontal field to `north`; ±1 beyond 90°."""
    sine = (seen[0] * north[1] - seen[1] * north[0]) / level
    if seen[0] * north[0] + seen[1] * north[1] < 0.0:
        return -1.0 if sine < 0.0 else 1.0
    return sine


@inline
def _gain(rate: float, dt: float, age: float, params: Params, adaptive: bool) -> float:
    """Return 1 − exp(−rate · dt); the adaptive filter starts as a mean and becomes a low-pass."""
    if adaptive:
        rate = max(rate, params.start_time / (age + dt))
    x = rate * dt
    if x > 0.5:
        return 1.0 - exp(-x)
    square = x * x
    return x / (1.0 + 0.5 * x + square * (1 / 12 - square * (1 / 720 - square * (1 / 30240))))


@inline
def _filtered(variance: float, gain: float, sigma: float) -> float:
    """Return the variance after one step of a low-pass over samples of `sigma`."""
    return (1.0 - gain) * (1.0 - gain) * variance + gain * gain * sigma * sigma
