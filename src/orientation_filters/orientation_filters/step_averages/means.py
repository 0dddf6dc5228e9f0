# SPDX-License-Identifier: Apache-2.0
"""Measurements of a step from its averages, and their variances.

The variances follow the acceleration left after a low-pass, the deviation of the field from its
reference, and rest.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import NamedTuple

from orientation_filters.kernel import inline
from orientation_filters.magnetic_reference import (
    FieldState,
    is_accepted,
    no_reference,
    update_reference,
)
from orientation_filters.rest_detection import DETECTABLE_TURN_RAD, is_bias
from orientation_filters.result import AT_REST, SIX_AXIS
from orientation_filters.rotation.scalars import (
    ZERO,
    Matrix,
    Quaternion,
    Symmetric,
    Vector,
    apply_symmetric,
    approach,
    dot,
    matrix,
    scale,
    subtract,
    transform,
)
from orientation_filters.sample_checks import GRAVITY
from orientation_filters.step_averages.accumulation import (
    INTERPOLATION_FACTOR,
    AveragingParams,
    AveragingState,
    no_integrals,
    rate_change,
    rest_flags,
)
from orientation_filters.step_averages.variance_factors import (
    FIELD_TIME_S,
    FORCE_TIME_S,
    VarianceFactors,
    add_bridged,
    no_error,
    observe_angle,
    observe_error,
    scaled,
    started_anew,
)

HEADING_ERROR_LIMIT = 0.35
"""Heading error up to which a field is never rejected [rad]."""
HEADING_SIGMAS_LIMIT = 3.0
"""The same in standard deviations of the heading; both add as squares."""
ADOPTED_HEADING_SIGMA = 0.1
"""Standard deviation of the heading from a newly adopted field [rad]."""
UNSETTLED_TILT_SIGMA = 0.035
"""Standard deviation of the inclination above which a reference is not relied on [rad]."""
SHORT_REFERENCE_S = 10.0
"""A reference known for less is learned anew where the tilt was found wrong [s]."""
LEAST_GAIN = 0.01
"""Least gain of a heading whose variance is no larger than what the tilt explains."""
PERSISTENCE_S = 10.0
"""Time after which an acceleration that persists is more likely a wrong tilt [s]."""
LEAST_AGE_S = 1.0
"""Time after the start from which a wrong tilt can be told from acceleration [s]."""
PERSISTENCE_FACTOR = 16.0
"""Multiple of its variance at which the mean over `PERSISTENCE_S` contradicts the tilt."""


class MeanForce(NamedTuple):
    """Specific force since the last step."""

    acceleration: Vector
    """Smoothed specific force less gravity, world [m/s²]."""
    variance: float
    """Of its horizontal parts [(m/s²)²]; −1: no specific force."""
    power: float
    smoothed: Vector
    persistent: Vector
    added_tilt_variance: float
    """Variance that acceleration which persists adds to the inclination [rad²]."""
    age: float


class MeanField(NamedTuple):
    """Magnetic field since the last step."""

    disturbance: Vector
    """Mean field less the reference, world [T]."""
    east: float
    """Sine of the angle of the field east of magnetic north."""
    variance: float
    """Of that angle [rad²]; −1: no field, or unlike the reference."""
    misfit: tuple[float, float]
    """Differences of horizontal and vertical part from the reference's, as parts of the horizontal
    one, each divided by √2: as angles, whose mean square is their sum of squares [rad]."""
    deviation: float
    reference: FieldState


class RestBias(NamedTuple):
    """Bias error seen at rest, along three directions."""

    directions: Matrix
    """The world's axes in the sensor frame."""
    error: Vector
    """Bias less mean rate, along each [rad/s]."""
    variance: Vector
    """[(rad/s)²]; −1: nothing is known along this direction."""


class Means(NamedTuple):
    """Measurements of a step, and the variance factors after it."""

    force: MeanForce
    field: MeanField
    rest: RestBias
    factors: VarianceFactors


@inline
def take_means(
    state: AveragingState,
    params: AveragingParams,
    bias: Vector,
    rows: Matrix,
    orientation: Symmetric,
    bias_covariance: Symmetric,
    flags: int,
) -> Means:
    """Return the means since the last step with their variances.

    `orientation` and `bias_covariance`: covariances before the step; `rows`: sensor → world.
    """
    force = _mean_force(state, params, orientation)
    tilt = 0.5 * (orientation[0] + orientation[3])
    is_unsettled = (
        force.added_tilt_variance > 0.0 or tilt > UNSETTLED_TILT_SIGMA * UNSETTLED_TILT_SIGMA
    )
    is_new = is_unsettled and state.reference.agreed_for < SHORT_REFERENCE_S
    reference = no_reference() if is_new else state.reference
    field = _mean_field(state, params, orientation, reference)
    return Means(
        force=force,
        field=field,
        rest=_bias_at_rest(state, params, bias, rows, bias_covariance, flags),
        factors=_variance_factors(state, params, force, field, orientation),
    )


@inline
def _variance_factors(
    state: AveragingState,
    params: AveragingParams,
    force: MeanForce,
    field: MeanField,
    orientation: Symmetric,
) -> VarianceFactors:
    """Return the variance factors after the innovations of a step.

    The low-pass of specific force delays its noise and removes accelerations, whose power is in
    the unused vertical part.
    """
    before, t = state.factors, state.integrals.elapsed
    rests = state.rest.duration >= params.rest.duration
    gaps = state.integrals.gaps
    bridged = (
        INTERPOLATION_FACTOR * rate_change(state) * gaps if gaps > params.interval**4 else 0.0
    )
    inclination = add_bridged(before.inclination, bridged)
    heading = add_bridged(before.heading, bridged)
    if field.reference.adopted:
        heading = started_anew(heading)
    force_error, field_error = before.force, before.field
    if force.variance > 0.0:
        a, pull = force.acceleration, 1.0 / GRAVITY
        white = params.acceleration_floor * params.acceleration_floor
        noise = 1.0 if rests else white / (white + force.power)
        inclination = observe_angle(
            inclination,
            (sqrt(0.5) * pull * a[0], sqrt(0.5) * pull * a[1]),
            (pull * a[2], 0.0),
            0.5 * (orientation[0] + orientation[3]),
            pull * pull * force.variance,
            t,
            noise * params.acceleration_smoothing,
            rests,
        )
        force_error = observe_error(force_error, inclination.unused, t, FORCE_TIME_S)
    if field.variance > 0.0:
        if field.reference.adopted:
            field_error = no_error()
        none, since = (0.0, 0.0), state.since_field + t
        heading = observe_angle(
            heading, (field.east, 0.0), none, orientation[5], field.variance, since, 0.0, rests
        )
        field_error = observe_error(field_error, field.misfit, since, FIELD_TIME_S)
    return VarianceFactors(
        inclination=inclination,
        heading=heading,
        force=force_error,
        field=field_error,
        rests=rests,
    )


@inline
def _mean_force(
    state: AveragingState, params: AveragingParams, orientation: Symmetric
) -> MeanForce:
    """Return the mean specific force; its variance follows the acceleration's power.

    What the low-pass leaves counts as acceleration where the tilt's own variance does not
    explain it; rest ends the memory of earlier acceleration. A rotation by a large angle is known
    to half of its square, as it is linearised.
    """
    t = state.integrals.elapsed
    force = scale(1.0 / t, state.integrals.force)
    power, age, variance, added = state.power, state.age, -1.0, 0.0
    smoothed, persistent = state.smoothed, state.persistent
    if dot(force, force) > 0.0:
        bridged = INTERPOLATION_FACTOR * rate_change(state) * state.integrals.gaps
        is_lost = bridged > 0.25 * (orientation[0] + orientation[3])
        age = t if is_lost else age + t
        gain = t / (min(params.acceleration_smoothing, age - t) + t)
        smoothed = approach(smoothed, force, gain)
        fast = subtract(force, smoothed)
        tilt = GRAVITY * GRAVITY * (orientation[0] + orientation[3])
        slow = max(smoothed[0] * smoothed[0] + smoothed[1] * smoothed[1] - 2.0 * tilt, 0.0)
        now = 0.5 * (
            params.acceleration_weight * (fast[0] * fast[0] + fast[1] * fast[1])
            + params.slow_weight * slow
        )
        rests = state.rest.duration >= params.rest.duration
        power = now if rests else power + (now - power) * t / (params.acceleration_memory + t)
        density = params.acceleration_floor * params.acceleration_floor + max(power, now)
        variance = density / min(t, params.interval)
        persistent = approach(persistent, force, t / (min(PERSISTENCE_S, age - t) + t))
        persistent_variance = 0.5 * tilt + density / min(PERSISTENCE_S, age)
        added = _tilt_error_square(persistent, params.up, persistent_variance)
    level = _level_part(smoothed, params.up)
    if variance > 0.0:
        square = level[0] * level[0] + level[1] * level[1]
        variance += 0.25 * square * square / (GRAVITY * GRAVITY)
    return MeanForce(
        acceleration=(level[0], level[1], smoothed[2] - params.up * GRAVITY),
        variance=variance,
        power=power,
        smoothed=smoothed,
        persistent=persistent,
        added_tilt_variance=added if age > LEAST_AGE_S else 0.0,
        age=age,
    )


@inline
def _tilt_error_square(persistent: Vector, up: float, variance: float) -> float:
    """Return the square of the tilt that a mean force shows [rad²]; 0: within its variance."""
    x, y = _level_part(persistent, up)
    square = x * x + y * y
    contradicts = square > PERSISTENCE_FACTOR * 2.0 * variance
    return square / (GRAVITY * GRAVITY) if contradicts else 0.0


@inline
def _level_part(force: Vector, up: float) -> tuple[float, float]:
    """Return the horizontal part of a force, that of a tilt by 90° where it points down."""
    x, y = force[0], force[1]
    if force[2] * up > 0.0:
        return x, y
    length = sqrt(x * x + y * y)
    right = 0.5 * pi * GRAVITY
    return (right * x / length, right * y / length) if length > 1e-6 else (right, 0.0)


@inline
def _mean_field(
    state: AveragingState, params: AveragingParams, orientation: Symmetric, known: FieldState
) -> MeanField:
    """Return the mean field's angle from north, unless it is unlike the reference.

    A tilt error turns the horizontal part of a field that dips and limits how well the heading is
    known; the dip itself is wrong by the tilt.
    """
    past, north, deviation = state.integrals, params.north, state.deviation
    if past.fields == 0:
        return _no_heading(ZERO, deviation, known)
    since = state.since_field + past.elapsed
    mean = scale(1.0 / past.fields, past.field)
    level = sqrt(mean[0] * mean[0] + mean[1] * mean[1])
    rate = sqrt(past.angle / past.elapsed)
    parts = (level, -params.up * mean[2])
    sine = _east(mean, level, north)
    possible = HEADING_SIGMAS_LIMIT * HEADING_SIGMAS_LIMIT * orientation[5]
    contradicts = sine * sine > possible + HEADING_ERROR_LIMIT * HEADING_ERROR_LIMIT
    reference = update_reference(known, params.field, parts, rate, since, contradicts)
    expected = reference.reference
    disturbance = (
        mean[0] - expected[0] * north[0],
        mean[1] - expected[0] * north[1],
        mean[2] + params.up * expected[1],
    )
    if not is_accepted(reference, params.field) or level <= 1e-3 * abs(mean[2]):
        return _no_heading(disturbance, deviation, reference)
    gap = level - expected[0]
    now = 0.5 * (gap * gap + disturbance[2] * disturbance[2]) / (level * level)
    deviation += (now - deviation) * since / (params.field_memory + since)
    noise = params.heading_noise * params.heading_noise
    variance = (noise + params.field_weight * max(deviation, now)) / since
    slope, inclined = mean[2] / level, orientation[0] + orientation[3]
    tilt, heading = 0.5 * (slope * slope + inclined) * inclined, orientation[5]
    variance += tilt * heading / max(heading - tilt, LEAST_GAIN * heading)
    variance += 0.25 * (sine * sine) * (sine * sine)
    return MeanField(
        disturbance=disturbance,
        east=sine,
        variance=variance,
        misfit=(sqrt(0.5) * gap / level, sqrt(0.5) * disturbance[2] / level),
        deviation=deviation,
        reference=reference,
    )


@inline
def _no_heading(disturbance: Vector, deviation: float, reference: FieldState) -> MeanField:
    """Return a field that shows no heading."""
    return MeanField(
        disturbance=disturbance,
        east=0.0,
        variance=-1.0,
        misfit=(0.0, 0.0),
        deviation=deviation,
        reference=reference,
    )


@inline
def _east(field: Vector, level: float, north: tuple[float, float]) -> float:
    """Return the sine of the angle of a field east of north; beyond 90° ±1."""
    if level == 0.0:
        return 0.0
    sine = (field[0] * north[1] - field[1] * north[0]) / level
    if field[0] * north[0] + field[1] * north[1] < 0.0:
        return -1.0 if sine < 0.0 else 1.0
    return sine


@inline
def _bias_at_rest(
    state: AveragingState,
    params: AveragingParams,
    bias: Vector,
    rows: Matrix,
    covariance: Symmetric,
    flags: int,
) -> RestBias:
    """Return the bias error that the mean rate at rest shows.

    With six axes a steady turn about the vertical cannot be told from a bias. The variance along
    the vertical is therefore so large that the bias keeps the square of its change as variance.
    """
    rest = state.rest
    learns = params.learn_bias and is_bias(rest, params.rest)
    if not learns or rest_flags(rest, params) != AT_REST:
        return RestBias(directions=rows, error=ZERO, variance=(-1.0, -1.0, -1.0))
    undetected = 0.25 * DETECTABLE_TURN_RAD / rest.duration
    noise = params.rest_noise * params.rest_noise / state.integrals.elapsed
    variance = noise + undetected * undetected
    vertical = variance
    if flags & SIX_AXIS:
        turn = dot(rows[2], subtract(rest.angular_velocity, rest.first_bias))
        square, known = turn * turn, dot(rows[2], apply_symmetric(covariance, rows[2]))
        vertical = variance + known * square / (known - square) if known > square else -1.0
    error = subtract(bias, rest.angular_velocity)
    return RestBias(
        directions=rows, error=transform(rows, error), variance=(variance, variance, vertical)
    )


@inline
def shown_covariance(covariance: Symmetric, means: Means, params: AveragingParams) -> Symmetric:
    """Return a covariance of the orientation [rad²] with the variance factors, where wanted."""
    return scaled(covariance, means.factors) if params.variance_factors else covariance


@inline
def after_step(state: AveragingState, means: Means, turn: Quaternion) -> AveragingState:
    """Return the state with cleared sums; the smoothed force is turned with the attitude."""
    past, rows = state.integrals, matrix(turn)
    since_field = 0.0 if past.fields else state.since_field + past.elapsed
    return AveragingState(
        integrals=no_integrals(),
        rate=state.rate,
        change=state.change,
        interval=state.interval,
        mean_rate=scale(1.0 / past.elapsed, past.rotation),
        rate_change=rate_change(state),
        power=means.force.power,
        smoothed=transform(rows, means.force.smoothed),
        persistent=transform(rows, means.force.persistent),
        deviation=means.field.deviation,
        age=means.force.age,
        rest=state.rest,
        reference=means.field.reference,
        since_field=since_field,
        factors=means.factors,
    )


@inline
def added_variances(
    state: AveragingState, means: Means, params: AveragingParams
) -> tuple[float, float]:
    """Return the variances to add to inclination and heading [rad²].

    They come of acceleration that persists and of a newly adopted field; the heading is set anew
    where the reference before had been known for less time than an adoption takes.
    """
    reference, tilt = means.field.reference, means.force.added_tilt_variance
    if not reference.adopted or state.reference.adopted:
        return tilt, tilt
    turn = tilt + ADOPTED_HEADING_SIGMA * ADOPTED_HEADING_SIGMA
    if state.reference.agreed_for < params.field.adoption:
        turn += means.field.east * means.field.east
    return tilt, turn
