# SPDX-License-Identifier: Apache-2.0
"""Adaptive Kalman step of the AHRS: means in the world frame, noise as motion shows it.

Between steps, `interval` apart, the gyroscope alone carries the attitude, and specific force and
field are averaged in the world frame, where gravity and the Earth's field stand still and
accelerations largely cancel. The errors are those of the indirect filter (orientation, bias,
linear acceleration, magnetic disturbance), orientation's now about the world's axes and with its
correlation to the bias kept, so that bias is learned in motion too. Linear acceleration and
disturbance are white from step to step; their variances follow what the means show.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from orientation_filters.ahrs.covariance import (
    ZERO6,
    Errors,
    JointCovariance,
    independent,
    observe,
    predict,
    widen,
    with_independent_bias,
)
from orientation_filters.ahrs.state import (
    MICROTESLA,
    AdaptiveParams,
    AdaptiveState,
    Integrals,
    Params,
    State,
    no_integrals,
)
from orientation_filters.kernel import inline
from orientation_filters.magnetic_reference import (
    FieldState,
    is_accepted,
    no_reference,
    norm_of,
    update_reference,
)
from orientation_filters.rest_detection import (
    DETECTABLE_TURN,
    RestState,
    is_bias,
    start_rest,
    update_rest,
)
from orientation_filters.result import AT_REST, BIAS_LIMITED, DISTURBED, JAMMED, JUMPED_BACK
from orientation_filters.rotation.scalars import (
    ZERO,
    Quaternion,
    Vector,
    add,
    approach,
    dot,
    from_rotation_vector,
    matrix,
    multiply,
    normalised,
    scale,
    subtract,
    to_sensor,
    transform,
)
from orientation_filters.sample_checks import GRAVITY, CheckedSample

START_CHECK = (1.0, 5.0)
"""Age at which the first attitude may be found wrong: accelerations have averaged out [s]."""
START_CHECK_FACTOR = 25.0
"""Multiple of its variance at which the mean force contradicts the first attitude."""
UNKNOWN_HEADING_VARIANCE = 10.0
"""Of the first heading without a field [rad²]."""
AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class MeanForce(NamedTuple):
    """Specific force since the last step."""

    acceleration: Vector
    """Smoothed specific force less gravity, world [m/s²]."""
    variance: float
    """Of its horizontal parts [(m/s²)²]; −1: no specific force."""
    power: float
    smoothed: Vector
    age: float


class MeanField(NamedTuple):
    """Magnetic field since the last step."""

    disturbance: Vector
    """Mean field less the reference, world [T]."""
    east: float
    """Sine of the angle of the field east of magnetic north."""
    variance: float
    """Of that angle [rad²]; −1: no field, or unlike the reference."""
    reference: FieldState


class RestBias(NamedTuple):
    """Bias error seen at rest."""

    error: Vector
    """Bias less mean rate [rad/s]."""
    variance: float
    """[(rad/s)²]; −1: not at rest."""


class Means(NamedTuple):
    """Measurements of a step, and the covariance before it."""

    prior: JointCovariance
    force: MeanForce
    field: MeanField
    rest: RestBias


@inline
def start_adaptive(
    state: AdaptiveState, params: AdaptiveParams, seen: CheckedSample, flags: int
) -> AdaptiveState:
    """Return the state at the first sample; a known field is remembered over gaps."""
    heading = params.initial_heading**2 if seen.has_field else UNKNOWN_HEADING_VARIANCE
    return AdaptiveState(
        covariance=independent(params.initial_inclination**2, heading, params.initial_bias**2),
        integrals=no_integrals(),
        power=0.0,
        smoothed=ZERO,
        age=0.0,
        rest=start_rest(seen.angular_velocity, seen.linear_acceleration, seen.magnetic_field),
        reference=no_reference() if flags & JUMPED_BACK else state.reference,
        since_field=0.0,
    )


@inline
def adaptive_update(
    state: State, params: Params, seen: CheckedSample, predicted: Quaternion, flags: int
) -> tuple[State, int]:
    """Return state and flags after a sample; every `interval` the errors are estimated."""
    state = accumulate(state, params, seen, predicted)
    if is_step_due(state, params):
        means = take_means(state, params)
        errors = estimate_errors(means, params.up)
        state = remove_errors(state, params, means, errors)
    return state, flags | adaptive_flags(state, params, seen)


@inline
def accumulate(state: State, params: Params, seen: CheckedSample, predicted: Quaternion) -> State:
    """Return the state with a sample added to the integrals, its attitude as predicted."""
    q = normalised(predicted)
    before = state.adaptive
    rest = before.rest
    if seen.has_force:
        rest = update_rest(rest, params.adaptive.rest, seen, state.bias)
    adaptive = AdaptiveState(
        covariance=before.covariance,
        integrals=_integrate(before.integrals, seen, q),
        power=before.power,
        smoothed=before.smoothed,
        age=before.age,
        rest=rest,
        reference=before.reference,
        since_field=before.since_field,
    )
    return State(
        stamp=seen.stamp,
        orientation=q,
        bias=state.bias,
        linear_acceleration=state.linear_acceleration,
        magnetic_disturbance=state.magnetic_disturbance,
        dip=state.dip,
        variances=state.variances,
        updates=state.updates,
        field_stamp=seen.stamp if seen.has_field else state.field_stamp,
        adaptive=adaptive,
    )


@inline
def _integrate(before: Integrals, seen: CheckedSample, q: Quaternion) -> Integrals:
    """Return the integrals with a sample added, turned to the world by the attitude."""
    rows, dt = matrix(q), seen.interval
    force, field = before.force, before.field
    if seen.has_force:
        force = add(force, scale(dt, transform(rows, seen.linear_acceleration)))
    if seen.has_field:
        field = add(field, transform(rows, seen.magnetic_field))
    return Integrals(
        elapsed=before.elapsed + dt,
        turned=(
            add(before.turned[0], scale(dt, rows[0])),
            add(before.turned[1], scale(dt, rows[1])),
            add(before.turned[2], scale(dt, rows[2])),
        ),
        force=force,
        field=field,
        fields=before.fields + seen.has_field,
        angle=before.angle + dt * dot(seen.angular_velocity, seen.angular_velocity),
    )


@inline
def is_step_due(state: State, params: Params) -> bool:
    """Whether the interval between Kalman steps has passed."""
    return state.adaptive.integrals.elapsed >= params.adaptive.interval


@inline
def take_means(state: State, params: Params) -> Means:
    """Return the means since the last step with their variances, and the predicted covariance."""
    prior = _predict(state.adaptive, params)
    force = _mean_force(state.adaptive, params)
    prior = _check_start(prior, params.adaptive, force, state.adaptive.integrals.elapsed)
    field = _mean_field(state.adaptive, params)
    if field.reference.adopted and not state.adaptive.reference.adopted:
        prior = widen(prior, 0.0, params.adaptive.initial_heading**2)
    rest = _bias_at_rest(state.adaptive, params, state.bias)
    return Means(prior=prior, force=force, field=field, rest=rest)


@inline
def _predict(state: AdaptiveState, params: Params) -> JointCovariance:
    """Return the covariance after the time since the last step."""
    past, noise = state.integrals, params.adaptive
    t = past.elapsed
    minus = (
        scale(-1.0, past.turned[0]),
        scale(-1.0, past.turned[1]),
        scale(-1.0, past.turned[2]),
    )
    walk = noise.angle_random_walk * noise.angle_random_walk * t
    walk += noise.rate_error * noise.rate_error * past.angle
    known, drift = state.covariance, noise.bias_random_walk * noise.bias_random_walk * t
    if not params.learn_bias:
        known, drift = with_independent_bias(known, ZERO6), 0.0
    return predict(known, minus, walk, drift)


@inline
def _mean_force(state: AdaptiveState, params: Params) -> MeanForce:
    """Return the mean specific force; its variance follows the acceleration's power."""
    t, noise = state.integrals.elapsed, params.adaptive
    force = scale(1.0 / t, state.integrals.force)
    power, smoothed, age, variance = state.power, state.smoothed, state.age, -1.0
    if dot(force, force) > 0.0:
        age += t
        smoothed = approach(smoothed, force, t / (min(noise.acceleration_smoothing, age - t) + t))
        now = 0.5 * (force[0] * force[0] + force[1] * force[1])
        power += (now - power) * t / (noise.acceleration_memory + t)
        density = noise.acceleration_floor * noise.acceleration_floor
        variance = (density + noise.acceleration_weight * max(power, now)) / t
    return MeanForce(
        acceleration=(smoothed[0], smoothed[1], smoothed[2] - params.up * GRAVITY),
        variance=variance,
        power=power,
        smoothed=smoothed,
        age=age,
    )


@inline
def _check_start(
    prior: JointCovariance, params: AdaptiveParams, force: MeanForce, t: float
) -> JointCovariance:
    """Return the covariance, wider where the mean force contradicts the first attitude."""
    if not (START_CHECK[0] < force.age < START_CHECK[1] and force.variance > 0.0):
        return prior
    variance = force.variance * (t / min(force.age, params.acceleration_smoothing + t))
    gap, gravity = dot(force.acceleration, force.acceleration), GRAVITY * GRAVITY
    if gap < START_CHECK_FACTOR * (gravity * prior.orientation[0] + variance):
        return prior
    return widen(prior, gap / gravity, gap / gravity)


@inline
def _mean_field(state: AdaptiveState, params: Params) -> MeanField:
    """Return the mean field's angle from north, unless it is unlike the reference."""
    past, north = state.integrals, params.north
    if past.fields == 0:
        return MeanField(disturbance=ZERO, east=0.0, variance=-1.0, reference=state.reference)
    since = state.since_field + past.elapsed
    mean = scale(1.0 / past.fields, past.field)
    level = sqrt(mean[0] * mean[0] + mean[1] * mean[1])
    rate = sqrt(past.angle / past.elapsed)
    parts = (level, -params.up * mean[2])
    reference = update_reference(state.reference, params.adaptive.field, parts, rate, since)
    expected = reference.reference
    disturbance = (
        mean[0] - expected[0] * north[0],
        mean[1] - expected[0] * north[1],
        mean[2] + params.up * expected[1],
    )
    if not is_accepted(reference, params.adaptive.field) or level <= 1e-3 * abs(mean[2]):
        return MeanField(disturbance=disturbance, east=0.0, variance=-1.0, reference=reference)
    # turning (x, y) to north is a rotation about z by this sine; beyond 90° by ±1
    sine = (mean[0] * north[1] - mean[1] * north[0]) / level
    if mean[0] * north[0] + mean[1] * north[1] < 0.0:
        sine = -1.0 if sine < 0.0 else 1.0
    variance = params.adaptive.heading_noise * params.adaptive.heading_noise / since
    return MeanField(disturbance=disturbance, east=sine, variance=variance, reference=reference)


@inline
def _bias_at_rest(state: AdaptiveState, params: Params, bias: Vector) -> RestBias:
    """Return the bias error that the mean rate at rest shows."""
    rest, noise = state.rest, params.adaptive
    learns = params.learn_bias and is_bias(rest, noise.rest)
    if not learns or _rest_flags(rest, noise) != AT_REST:
        return RestBias(error=ZERO, variance=-1.0)
    undetected = 0.25 * DETECTABLE_TURN / rest.duration
    return RestBias(
        error=subtract(bias, rest.angular_velocity),
        variance=noise.rest_noise * noise.rest_noise / state.integrals.elapsed
        + undetected * undetected,
    )


@inline
def estimate_errors(means: Means, up: float) -> Errors:
    """Return the errors after all measurements, one after the other."""
    errors = Errors(orientation=ZERO, bias=ZERO, covariance=means.prior)
    if means.force.variance > 0.0:
        pull, a, r = up * GRAVITY, means.force.acceleration, means.force.variance
        errors = observe(errors, (0.0, pull, 0.0), ZERO, a[0], r)
        errors = observe(errors, (-pull, 0.0, 0.0), ZERO, a[1], r)
    if means.field.variance > 0.0:
        errors = observe(errors, (0.0, 0.0, -1.0), ZERO, means.field.east, means.field.variance)
    if means.rest.variance > 0.0:
        e, r = means.rest.error, means.rest.variance
        errors = observe(errors, ZERO, AXES[0], e[0], r)
        errors = observe(errors, ZERO, AXES[1], e[1], r)
        errors = observe(errors, ZERO, AXES[2], e[2], r)
    return errors


@inline
def remove_errors(state: State, params: Params, means: Means, errors: Errors) -> State:
    """Return the state with the estimated errors taken away and nothing accumulated."""
    turn = from_rotation_vector(scale(-1.0, errors.orientation))
    q = normalised(multiply(turn, state.orientation))
    rows = matrix(q)
    has_field = state.adaptive.integrals.fields > 0
    disturbance, dip = state.magnetic_disturbance, state.dip
    if has_field:
        disturbance = scale(MICROTESLA, to_sensor(rows, means.field.disturbance))
        dip = _dip_of(means.field.reference, dip)
    return State(
        stamp=state.stamp,
        orientation=q,
        bias=subtract(state.bias, errors.bias),
        linear_acceleration=to_sensor(rows, _remaining_acceleration(means, errors, params.up)),
        magnetic_disturbance=disturbance,
        dip=dip,
        variances=state.variances,
        updates=state.updates + 1,
        field_stamp=state.field_stamp,
        adaptive=_after_step(state.adaptive, params, means, errors, turn),
    )


@inline
def _after_step(
    before: AdaptiveState, params: Params, means: Means, errors: Errors, turn: Quaternion
) -> AdaptiveState:
    """Return the state with nothing accumulated, the smoothed force turned as the attitude was."""
    covariance = errors.covariance
    if not params.learn_bias:
        covariance = with_independent_bias(covariance, before.covariance.bias)
    past = before.integrals
    return AdaptiveState(
        covariance=covariance,
        integrals=no_integrals(),
        power=means.force.power,
        smoothed=transform(matrix(turn), means.force.smoothed),
        age=means.force.age,
        rest=before.rest,
        reference=means.field.reference,
        since_field=0.0 if past.fields else before.since_field + past.elapsed,
    )


@inline
def _remaining_acceleration(means: Means, errors: Errors, up: float) -> Vector:
    """Return the acceleration that the errors do not explain, world [m/s²]."""
    a, turn, pull = means.force.acceleration, errors.orientation, up * GRAVITY
    return a[0] - pull * turn[1], a[1] + pull * turn[0], a[2]


@inline
def _dip_of(reference: FieldState, before: tuple[float, float]) -> tuple[float, float]:
    """Return cosine and sine of the reference's inclination."""
    level, sunk = reference.reference
    length = norm_of(reference)
    return (level / length, sunk / length) if length > 0.0 else before


@inline
def adaptive_flags(state: State, params: Params, seen: CheckedSample) -> int:
    """Return AT_REST, BIAS_LIMITED, DISTURBED, JAMMED as they stand after a sample."""
    flags = _rest_flags(state.adaptive.rest, params.adaptive)
    reference = state.adaptive.reference
    strength = norm_of(reference)
    if strength > 0.0 and not is_accepted(reference, params.adaptive.field):
        flags |= DISTURBED
    strength *= MICROTESLA
    d = state.magnetic_disturbance
    if seen.has_field and dot(d, d) > 4.0 * strength * strength:
        flags |= JAMMED
    return flags


@inline
def _rest_flags(rest: RestState, params: AdaptiveParams) -> int:
    """Return AT_REST, and BIAS_LIMITED where the rate is too large for a bias."""
    if rest.duration < params.rest.duration:
        return 0
    mean, limit = rest.angular_velocity, params.rest.bias_limit
    return AT_REST | BIAS_LIMITED if dot(mean, mean) > limit * limit else AT_REST
