# SPDX-License-Identifier: Apache-2.0
"""The adaptive filter's step on the AHRS's state: gather every sample, correct every interval."""

from __future__ import annotations

from orientation_filters.ahrs.adaptive import (
    Observation,
    after_step,
    dip_of,
    flags_now,
    gather,
    unexplained,
)
from orientation_filters.ahrs.joint_covariance import Errors, uncoupled
from orientation_filters.ahrs.state import MICROTESLA, Params, State
from orientation_filters.kernel import inline
from orientation_filters.magnetic_reference import norm_of
from orientation_filters.result import INVALID_ACCELEROMETER, JAMMED
from orientation_filters.rotation.scalars import (
    Quaternion,
    Vector,
    dot,
    from_rotation_vector,
    matrix,
    multiply,
    normalised,
    scale,
    subtract,
    to_sensor,
)


@inline
def gather_sample(  # noqa: PLR0913, PLR0917 (what update has prepared)
    state: State,
    params: Params,
    stamp: int,
    q: Quaternion,
    w: Vector,
    f: Vector,
    m: Vector,
    has_field: bool,
    flags: int,
) -> tuple[State, bool, int]:
    """Return the adaptive filter's state with a sample added, whether a step is due, flags."""
    dt = (stamp - state.stamp) * 1e-9
    has_force = not flags & INVALID_ACCELEROMETER
    q = normalised(q)
    since = (stamp - state.field_stamp) * 1e-9
    a = gather(
        state.adaptive,
        params.adaptive,
        matrix(q),
        w,
        f,
        has_force,
        m,
        has_field,
        dt,
        since,
        state.bias,
    )
    state = State(
        stamp,
        q,
        state.bias,
        state.linear_acceleration,
        state.magnetic_disturbance,
        state.dip,
        state.variances,
        state.updates,
        stamp if has_field else state.field_stamp,
        a,
    )
    return state, a.elapsed >= params.adaptive.interval, flags


@inline
def apply_errors(state: State, params: Params, seen: Observation, errors: Errors) -> State:
    """Return the adaptive filter's state with the estimated errors taken away."""
    turn = from_rotation_vector(scale(-1.0, errors.orientation))
    q = normalised(multiply(turn, state.orientation))
    rows = matrix(q)
    covariance = errors.covariance
    if not params.adaptive.learn_bias:
        covariance = uncoupled(covariance, state.adaptive.covariance.bias)
    disturbance, dip = state.magnetic_disturbance, state.dip
    if state.adaptive.fields:
        disturbance = scale(MICROTESLA, to_sensor(rows, seen.disturbance))
        dip = dip_of(seen.reference, dip)
    return State(
        state.stamp,
        q,
        subtract(state.bias, errors.bias),
        to_sensor(rows, unexplained(seen, errors, params.up)),
        disturbance,
        dip,
        state.variances,
        state.updates + 1,
        state.field_stamp,
        after_step(
            state.adaptive,
            seen.power,
            seen.smoothed,
            seen.age,
            seen.reference,
            covariance,
            matrix(turn),
        ),
    )


@inline
def flags_after(state: State, params: Params, has_field: bool, flags: int) -> int:
    """Return the flags with what the adaptive filter knows after the sample."""
    flags |= flags_now(state.adaptive, params.adaptive)
    strength = MICROTESLA * norm_of(state.adaptive.reference)
    d = state.magnetic_disturbance
    if has_field and dot(d, d) > 4.0 * strength * strength:
        flags |= JAMMED
    return flags
