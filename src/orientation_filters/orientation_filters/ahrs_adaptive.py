# SPDX-License-Identifier: Apache-2.0
"""The AHRS's Kalman step when it adapts: averaged in the world, weighed by what motion shows.

Between steps, `interval` apart, the gyroscope alone carries the attitude, and specific force and
field are averaged in the world frame, where gravity and the Earth's field stand still and
accelerations largely cancel. The errors are those of the indirect filter (orientation, bias,
linear acceleration, magnetic disturbance), orientation's now about the world's axes and with its
correlation to the bias kept, so that bias is learned in motion too. Linear acceleration and
disturbance are white from step to step; their variances follow what the averages show.
"""

from __future__ import annotations

from typing import NamedTuple

from orientation_filters.flags import AT_REST, BIAS_LIMITED, DISTURBED
from orientation_filters.joint_covariance import JointCovariance
from orientation_filters.kernel import inline
from orientation_filters.magnetic_reference import (
    FieldParams,
    FieldState,
    no_reference,
    norm_of,
)
from orientation_filters.quaternion import Matrix, Vector, absent, add, dot, scale, transform
from orientation_filters.rest import RestParams, RestState, start_rest, watch_rest

GRAVITY = 9.81
ZERO = (0.0, 0.0, 0.0)
AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class AdaptiveParams(NamedTuple):
    """Noises as densities: they do not depend on the sample rate."""

    enabled: bool
    learn_bias: bool
    interval: float
    """Between Kalman steps [s]."""
    angle_random_walk: float
    """[rad/√s]"""
    rate_error: float
    """Error of the angular velocity as a part of itself, random over a second."""
    bias_random_walk: float
    """[rad/s/√s]"""
    acceleration_floor: float
    """Density of specific force's error at rest [m/s² √s]."""
    acceleration_weight: float
    """How much of the acceleration's power counts as density [s]."""
    acceleration_memory: float
    """Over which that power is averaged [s]."""
    acceleration_smoothing: float
    """Time constant of specific force's low-pass in the world frame [s]."""
    heading_noise: float
    """Density of the undisturbed field's heading error [rad √s]."""
    rest_noise: float
    """Density of the resting gyroscope's error [rad/s √s]."""
    initial_inclination: float
    """Standard deviation at the start [rad]."""
    initial_heading: float
    """Standard deviation at the start [rad]."""
    initial_bias: float
    """Standard deviation at the start [rad/s]."""
    rest: RestParams
    field: FieldParams


class AdaptiveState(NamedTuple):
    """What is gathered between two steps, and what the steps know."""

    covariance: JointCovariance
    elapsed: float
    """Since the last step [s]."""
    turned: Matrix
    """Integral of the attitude's matrix over that time [s]."""
    force: Vector
    """Integral of specific force, world [m/s]."""
    field: Vector
    """Sum of fields, world [T]."""
    fields: int
    angle: float
    """Integral of |angular velocity|² [rad²/s]."""
    power: float
    """Running mean of the horizontal acceleration's square, per axis [(m/s²)²]."""
    smoothed: Vector
    """Specific force after its low-pass, world [m/s²]."""
    age: float
    """Since the start, of steps with a specific force [s]."""
    rest: RestState
    reference: FieldState
    since_field: float
    """Time since the last step with a field [s]."""


@inline
def start_adaptive(
    params: AdaptiveParams, w: Vector, f: Vector, m: Vector, field: FieldState
) -> AdaptiveState:
    """Return the state at the first sample; a known field is remembered over gaps."""
    tilt, bias = params.initial_inclination**2, params.initial_bias**2
    turn = params.initial_heading**2 if not absent(m) else 10.0
    covariance = JointCovariance(
        (tilt, 0.0, 0.0, tilt, 0.0, turn), (ZERO, ZERO, ZERO), (bias, 0.0, 0.0, bias, 0.0, bias)
    )
    rest = start_rest(w, f, m)
    return AdaptiveState(
        covariance, 0.0, (ZERO, ZERO, ZERO), ZERO, ZERO, 0, 0.0, 0.0, ZERO, 0.0, rest, field, 0.0
    )


def no_adaptive_state() -> AdaptiveState:
    """Return the state before any sample."""
    none = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    covariance = JointCovariance(none, (ZERO, ZERO, ZERO), none)
    rest = start_rest(ZERO, ZERO, ZERO)
    return AdaptiveState(
        covariance,
        0.0,
        (ZERO, ZERO, ZERO),
        ZERO,
        ZERO,
        0,
        0.0,
        0.0,
        ZERO,
        0.0,
        rest,
        no_reference(),
        0.0,
    )


@inline
def gather(  # noqa: PLR0913, PLR0917 (one sample's quantities)
    state: AdaptiveState,
    params: AdaptiveParams,
    rows: Matrix,
    w: Vector,
    f: Vector,
    has_force: bool,
    m: Vector,
    has_field: bool,
    dt: float,
    since_field: float,
    bias: Vector,
) -> AdaptiveState:
    """Return the state with one sample added; rows: attitude, sensor → world."""
    turned = state.turned
    force = state.force
    rest = state.rest
    if has_force:
        force = (
            force[0] + dt * dot(rows[0], f),
            force[1] + dt * dot(rows[1], f),
            force[2] + dt * dot(rows[2], f),
        )
        rest = watch_rest(rest, params.rest, w, f, m, has_field, dt, since_field, bias)
    field = state.field
    if has_field:
        field = (
            field[0] + dot(rows[0], m),
            field[1] + dot(rows[1], m),
            field[2] + dot(rows[2], m),
        )
    return AdaptiveState(
        state.covariance,
        state.elapsed + dt,
        (
            add(turned[0], scale(dt, rows[0])),
            add(turned[1], scale(dt, rows[1])),
            add(turned[2], scale(dt, rows[2])),
        ),
        force,
        field,
        state.fields + has_field,
        state.angle + dt * dot(w, w),
        state.power,
        state.smoothed,
        state.age,
        rest,
        state.reference,
        state.since_field,
    )


@inline
def rest_flags(rest: RestState, params: AdaptiveParams) -> int:
    """Return AT_REST, and BIAS_LIMITED where the rate is too large for a bias."""
    if rest.duration < params.rest.duration:
        return 0
    mean, limit = rest.angular_velocity, params.rest.bias_limit
    return AT_REST | BIAS_LIMITED if dot(mean, mean) > limit * limit else AT_REST


@inline
def flags_now(state: AdaptiveState, params: AdaptiveParams) -> int:
    """Return AT_REST, BIAS_LIMITED, DISTURBED as they stand."""
    flags = rest_flags(state.rest, params)
    reference = state.reference
    if norm_of(reference) > 0.0 and reference.accepted_for < params.field.hold:
        flags |= DISTURBED
    return flags


@inline
def after_step(
    state: AdaptiveState,
    power: float,
    smoothed: Vector,
    age: float,
    reference: FieldState,
    covariance: JointCovariance,
    turn: Matrix,
) -> AdaptiveState:
    """Return the state with nothing gathered, its averages turned as the attitude was."""
    return AdaptiveState(
        covariance,
        0.0,
        (ZERO, ZERO, ZERO),
        ZERO,
        ZERO,
        0,
        0.0,
        power,
        transform(turn, smoothed),
        age,
        state.rest,
        reference,
        0.0 if state.fields else state.since_field + state.elapsed,
    )
