# SPDX-License-Identifier: Apache-2.0
"""The Kalman step of the technical note: every sample, in the sensor frame."""

from __future__ import annotations

from math import sqrt

from orientation_filters.ahrs.measurement_update import correct, predict_variances, with_bias
from orientation_filters.ahrs.state import GRAVITY, MICROTESLA, ZERO, Params, State
from orientation_filters.kernel import inline
from orientation_filters.result import INVALID_ACCELEROMETER, JAMMED
from orientation_filters.rotation.scalars import (
    Matrix,
    Quaternion,
    Vector,
    from_rotation_vector,
    matrix,
    multiply,
    normalised,
    scale,
    subtract,
    transform,
)


@inline
def paper_step(  # noqa: PLR0913, PLR0917 (what update has prepared)
    state: State,
    params: Params,
    stamp: int,
    q: Quaternion,
    f: Vector,
    m: Vector,
    dt: float,
    has_field: bool,
    flags: int,
) -> tuple[State, int]:
    """Compare what the sensors say with what the attitude predicts, and take the error away."""
    noise, strength = params.noise, params.field_strength
    learns = params.adaptive.learn_bias
    prior, coupling = state.variances if learns else with_bias(state.variances, ZERO), ZERO
    if state.updates > 0:
        prior, coupling = predict_variances(prior, noise, dt)
    if not learns:
        prior, coupling = with_bias(prior, ZERO), ZERO
    rows = matrix(q)
    down = scale(-params.up, rows[2])
    gravity = scale(GRAVITY, down)
    expected = _expected_field(rows, down, params, state.dip)
    acceleration = scale(noise.linear_acceleration_decay, state.linear_acceleration)
    has_gravity = not flags & INVALID_ACCELEROMETER
    z_gravity, z_field = ZERO, ZERO
    if has_gravity:
        z_gravity = subtract(subtract(acceleration, f), gravity)
    if has_field:
        z_field = subtract(scale(MICROTESLA, m), expected)
    c = correct(
        prior,
        coupling,
        noise,
        dt,
        gravity,
        z_gravity,
        has_gravity,
        expected,
        z_field,
        has_field,
        2.0 * strength,
    )
    q = normalised(multiply(q, from_rotation_vector(scale(-1.0, c.orientation))))
    dip = state.dip
    if c.jammed:
        flags |= JAMMED
    elif has_field:
        dip = _corrected_dip(q, params, dip, c.disturbance)
    state = State(
        stamp,
        q,
        subtract(state.bias, c.bias),
        subtract(acceleration, c.acceleration),
        c.disturbance if has_field else state.magnetic_disturbance,
        dip,
        c.variances if learns else with_bias(c.variances, state.variances.bias),
        state.updates + 1,
        stamp if has_field else state.field_stamp,
        state.adaptive,
    )
    return state, flags


@inline
def _expected_field(
    rows: Matrix, down: Vector, params: Params, dip: tuple[float, float]
) -> Vector:
    """Return the field of the expected strength and dip [µT], sensor frame."""
    level = params.field_strength * dip[0]
    east, north = level * params.north[0], level * params.north[1]
    sunk = params.field_strength * dip[1]
    return (
        east * rows[0][0] + north * rows[1][0] + sunk * down[0],
        east * rows[0][1] + north * rows[1][1] + sunk * down[1],
        east * rows[0][2] + north * rows[1][2] + sunk * down[2],
    )


@inline
def _corrected_dip(
    q: Quaternion, params: Params, dip: tuple[float, float], disturbance: Vector
) -> tuple[float, float]:
    """Return the dip of the expected field less the disturbance, −90° … 90°."""
    d = transform(matrix(q), disturbance)
    level = params.field_strength * dip[0] - params.north[0] * d[0] - params.north[1] * d[1]
    sunk = params.field_strength * dip[1] + params.up * d[2]
    level = max(level, 0.0)
    length = sqrt(level * level + sunk * sunk)
    if length < 1e-9:
        return dip
    return level / length, sunk / length
