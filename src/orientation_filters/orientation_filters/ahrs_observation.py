# SPDX-License-Identifier: Apache-2.0
"""What the adaptive AHRS's averages say at a step, and the errors that follow from it."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from orientation_filters.ahrs_adaptive import (
    GRAVITY,
    ZERO,
    AdaptiveParams,
    AdaptiveState,
    rest_flags,
)
from orientation_filters.flags import AT_REST
from orientation_filters.joint_covariance import (
    Errors,
    JointCovariance,
    doubt,
    observe,
    predict,
    uncoupled,
)
from orientation_filters.kernel import inline
from orientation_filters.magnetic_reference import FieldState, judge_field, norm_of
from orientation_filters.quaternion import Vector, approach, dot, scale
from orientation_filters.rest import TURN, is_bias

START = (1.0, 5.0)
"""Time in which the first attitude may turn out wrong: pushes have averaged out [s]."""
NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


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
