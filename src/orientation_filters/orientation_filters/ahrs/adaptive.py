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

from math import sqrt
from typing import NamedTuple

from orientation_filters.ahrs.joint_covariance import (
    Errors,
    JointCovariance,
    doubt,
    observe,
    predict,
    uncoupled,
)
from orientation_filters.kernel import inline
from orientation_filters.magnetic_reference import (
    FieldParams,
    FieldState,
    judge_field,
    no_reference,
    norm_of,
)
from orientation_filters.rest_detection import (
    TURN,
    RestParams,
    RestState,
    is_bias,
    start_rest,
    watch_rest,
)
from orientation_filters.result import AT_REST, BIAS_LIMITED, DISTURBED
from orientation_filters.rotation.scalars import (
    Matrix,
    Vector,
    absent,
    add,
    approach,
    dot,
    scale,
    transform,
)

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


START = (1.0, 5.0)
"""Time in which the first attitude may turn out wrong: pushes have averaged out [s]."""
NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Observation(NamedTuple):
    """What a step has to take in."""

    prior: JointCovariance
    acceleration: Vector
    """Mean specific force less gravity, world [m/s²]."""
    force_variance: float
    """Of its horizontal parts [(m/s²)²]; −1: no specific force."""
    disturbance: Vector
    """Mean field less the reference, world [T]."""
    east: float
    """Angle of the field east of magnetic north [rad], small."""
    east_variance: float
    """[rad²]; −1: no field to be taken in."""
    rest_error: Vector
    """Bias less mean rate at rest [rad/s]."""
    rest_variance: float
    """[(rad/s)²]; −1: not at rest."""
    power: float
    smoothed: Vector
    age: float
    reference: FieldState


@inline
def weigh(
    state: AdaptiveState,
    params: AdaptiveParams,
    bias: Vector,
    up: float,
    north: tuple[float, float],
) -> Observation:
    """Return what the averages say, with the variances they deserve."""
    t = state.elapsed
    minus = (
        scale(-1.0, state.turned[0]),
        scale(-1.0, state.turned[1]),
        scale(-1.0, state.turned[2]),
    )
    walk = params.angle_random_walk * params.angle_random_walk * t
    walk += params.rate_error * params.rate_error * state.angle
    known, drift = state.covariance, params.bias_random_walk * params.bias_random_walk * t
    if not params.learn_bias:
        known, drift = uncoupled(known, NOTHING), 0.0
    prior = predict(known, minus, walk, drift)
    force = scale(1.0 / t, state.force)
    power, smoothed, age = state.power, state.smoothed, state.age
    force_variance = -1.0
    if dot(force, force) > 0.0:
        age += t
        smoothed = approach(smoothed, force, t / (min(params.acceleration_smoothing, age - t) + t))
        now = 0.5 * (force[0] * force[0] + force[1] * force[1])
        power += (now - power) * t / (params.acceleration_memory + t)
        density = params.acceleration_floor * params.acceleration_floor
        force_variance = (density + params.acceleration_weight * max(power, now)) / t
    acceleration = (smoothed[0], smoothed[1], smoothed[2] - up * GRAVITY)
    if START[0] < age < START[1] and force_variance > 0.0:
        averaged = t / min(age, params.acceleration_smoothing + t)
        prior = _doubt_start(prior, acceleration, force_variance * averaged)
    east, east_variance, disturbance, reference = _weigh_field(state, params, up, north)
    if reference.adopted and not state.reference.adopted:
        prior = doubt(prior, 0.0, params.initial_heading * params.initial_heading)
    rest_error, rest_variance = _weigh_rest(state, params, bias)
    return Observation(
        prior,
        acceleration,
        force_variance,
        disturbance,
        east,
        east_variance,
        rest_error,
        rest_variance,
        power,
        smoothed,
        age,
        reference,
    )


@inline
def _doubt_start(prior: JointCovariance, acceleration: Vector, variance: float) -> JointCovariance:
    """Return the covariance of an attitude that mean specific force less gravity contradicts."""
    gap, gravity = dot(acceleration, acceleration), GRAVITY * GRAVITY
    if gap < 25.0 * (gravity * prior.orientation[0] + variance):
        return prior
    return doubt(prior, gap / gravity, gap / gravity)


@inline
def _weigh_field(
    state: AdaptiveState, params: AdaptiveParams, up: float, north: tuple[float, float]
) -> tuple[float, float, Vector, FieldState]:
    """Return the field's angle from north, its variance, the disturbance and the reference."""
    reference = state.reference
    if state.fields == 0:
        return 0.0, -1.0, ZERO, reference
    since = state.since_field + state.elapsed
    mean = scale(1.0 / state.fields, state.field)
    level = sqrt(mean[0] * mean[0] + mean[1] * mean[1])
    rate = sqrt(state.angle / state.elapsed)
    reference = judge_field(reference, params.field, (level, -up * mean[2]), rate, since)
    expected = reference.reference
    disturbance = (
        mean[0] - expected[0] * north[0],
        mean[1] - expected[0] * north[1],
        mean[2] + up * expected[1],
    )
    if reference.accepted_for < params.field.hold or level <= 1e-3 * abs(mean[2]):
        return 0.0, -1.0, disturbance, reference
    # turning (x, y) to north is a rotation about z by this sine; beyond 90° by ±1
    sine = (mean[0] * north[1] - mean[1] * north[0]) / level
    if mean[0] * north[0] + mean[1] * north[1] < 0.0:
        sine = -1.0 if sine < 0.0 else 1.0
    return sine, params.heading_noise * params.heading_noise / since, disturbance, reference


@inline
def _weigh_rest(
    state: AdaptiveState, params: AdaptiveParams, bias: Vector
) -> tuple[Vector, float]:
    """Return bias less mean rate and its variance."""
    flags = rest_flags(state.rest, params)
    surely = is_bias(state.rest, params.rest)
    if flags != AT_REST or not (params.learn_bias and surely):
        return ZERO, -1.0
    mean = state.rest.angular_velocity
    error = (bias[0] - mean[0], bias[1] - mean[1], bias[2] - mean[2])
    unseen = 0.25 * TURN / state.rest.duration
    return error, params.rest_noise * params.rest_noise / state.elapsed + unseen * unseen


@inline
def unexplained(seen: Observation, errors: Errors, up: float) -> Vector:
    """Return the acceleration that the errors do not explain, world [m/s²]."""
    a, turn, pull = seen.acceleration, errors.orientation, up * GRAVITY
    return a[0] - pull * turn[1], a[1] + pull * turn[0], a[2]


@inline
def dip_of(reference: FieldState, before: tuple[float, float]) -> tuple[float, float]:
    """Return cosine and sine of the reference's inclination."""
    level, sunk = reference.reference
    length = norm_of(reference)
    return (level / length, sunk / length) if length > 0.0 else before


@inline
def take_in(seen: Observation, up: float) -> Errors:
    """Return the errors after all measurements, one after the other."""
    errors = Errors(ZERO, ZERO, seen.prior)
    if seen.force_variance > 0.0:
        pull = up * GRAVITY
        a = seen.acceleration
        errors = observe(errors, (0.0, pull, 0.0), ZERO, a[0], seen.force_variance)
        errors = observe(errors, (-pull, 0.0, 0.0), ZERO, a[1], seen.force_variance)
    if seen.east_variance > 0.0:
        errors = observe(errors, (0.0, 0.0, -1.0), ZERO, seen.east, seen.east_variance)
    if seen.rest_variance > 0.0:
        e, r = seen.rest_error, seen.rest_variance
        errors = observe(errors, ZERO, AXES[0], e[0], r)
        errors = observe(errors, ZERO, AXES[1], e[1], r)
        errors = observe(errors, ZERO, AXES[2], e[2], r)
    return errors
