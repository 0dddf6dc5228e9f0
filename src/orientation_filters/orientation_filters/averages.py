# SPDX-License-Identifier: Apache-2.0
"""Means over short steps in the world frame, what they measure, and how well.

Both robust filters stand on this. Between steps, `interval` apart, the gyroscope alone carries the
attitude, its rate a straight line from sample to sample, over gaps too. Specific force and field
are averaged in the world frame, where gravity and the Earth's field stand still and accelerations
largely cancel. The variances follow what the means show: acceleration left over after a low-pass,
deviation of the field from its reference, rest.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import NamedTuple

from orientation_filters.kernel import inline
from orientation_filters.magnetic_reference import (
    FieldParams,
    FieldState,
    is_accepted,
    no_reference,
    norm_of,
    update_reference,
)
from orientation_filters.rest_detection import (
    DETECTABLE_TURN,
    RestParams,
    RestState,
    is_bias,
    start_rest,
    update_rest,
)
from orientation_filters.result import (
    AT_REST,
    BIAS_LIMITED,
    DISTURBED,
    JAMMED,
    JUMPED_BACK,
    SIX_AXIS,
)
from orientation_filters.rotation.scalars import (
    ZERO,
    Matrix,
    Quaternion,
    Symmetric,
    Vector,
    add,
    apply_symmetric,
    approach,
    dot,
    from_rotation_vector,
    matrix,
    multiply,
    normalised,
    scale,
    subtract,
    transform,
)
from orientation_filters.sample_checks import GRAVITY, CheckedSample

UNKNOWN_HEADING_VARIANCE = 3.29
"""Of a heading that may be anything: π² / 3 [rad²]."""
START_POWER = 4.0
"""Square of an acceleration that may be there at the start, per axis [(m/s²)²]."""
POSSIBLE_ANGLE, POSSIBLE_SIGMAS = 0.35, 3.0
"""A field is rejected whose heading differs by more [rad], and by more standard deviations."""
ADOPTION_DOUBT = 0.1
"""Standard deviation of the heading that a newly adopted field shows [rad]."""
UNSETTLED_TILT = 0.035
"""Standard deviation of the inclination above which a field cannot be judged [rad]."""
RELEARNED = 10.0
"""A field seen for less is learned anew where the tilt was found wrong [s]."""
LEAST_GAIN = 0.01
"""Part of a heading that corrects one whose variance is no larger than the tilt explains."""
PERSISTENCE = 10.0
"""Time over which an acceleration that persists is more likely a wrong tilt [s]."""
LEAST_AGE = 1.0
"""Accelerations have had the time to average out [s]."""
PERSISTENCE_FACTOR = 16.0
"""Multiple of its variance at which the mean over that time contradicts the tilt."""
BRIDGE = 1 / 16
"""Error² of an angle over a gap h on a straight line, in (change of rate per second)² h⁴."""
HELD = 1 / 4
"""The same of an angle carried on by the last rate."""


class AveragingParams(NamedTuple):
    """Noises of the means, as densities: they do not depend on the sample rate."""

    up: float
    """World z of the upward direction: +1 ENU, −1 NED."""
    north: tuple[float, float]
    """World x, y of magnetic north (unit vector)."""
    learn_bias: bool
    interval: float
    """Between steps [s]."""
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
    slow_weight: float
    """The same of the power left after the low-pass [s]."""
    acceleration_memory: float
    """Time constant of the mean of those powers [s]."""
    acceleration_smoothing: float
    """Time constant of specific force's low-pass in the world frame [s]."""
    heading_noise: float
    """Density of the undisturbed field's heading error [rad √s]."""
    field_weight: float
    """How much of the square of the field's deviation counts as density [s]."""
    field_memory: float
    """Time constant of the mean of that square [s]."""
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


class Integrals(NamedTuple):
    """Samples added up since the last step."""

    elapsed: float
    """[s]"""
    turned: Matrix
    """Integral of the attitude's matrix over time [s]."""
    force: Vector
    """Integral of specific force, world [m/s]."""
    field: Vector
    """Sum of fields, world [T]."""
    fields: int
    """Number of fields in the sum."""
    angle: float
    """Integral of |angular velocity|² [rad²/s]."""
    rotation: Vector
    """Integral of angular velocity, sensor [rad]."""
    gaps: float
    """Sum of the fourth powers of the intervals [s⁴]."""


class AveragingState(NamedTuple):
    """What the means leave from sample to sample and from step to step."""

    integrals: Integrals
    rate: Vector
    """Angular velocity of the last sample [rad/s], sensor frame."""
    mean_rate: Vector
    """Of the last step [rad/s], sensor frame."""
    rate_change: float
    """Running mean of the square of the change of rate per second [(rad/s²)²]."""
    power: float
    """Running mean of the density of specific force's error from acceleration [(m/s²)² s]."""
    smoothed: Vector
    """Specific force after its low-pass, world [m/s²]."""
    persistent: Vector
    """Mean specific force over `PERSISTENCE`, world [m/s²]."""
    deviation: float
    """Running mean square of the field's distance from the reference, per part, as a part of its
    horizontal part."""
    age: float
    """Since the start, of steps with a specific force [s]."""
    rest: RestState
    reference: FieldState
    since_field: float
    """Time since the last step with a field [s]."""


class MeanForce(NamedTuple):
    """Specific force since the last step."""

    acceleration: Vector
    """Smoothed specific force less gravity, world [m/s²]."""
    variance: float
    """Of its horizontal parts [(m/s²)²]; −1: no specific force."""
    power: float
    smoothed: Vector
    persistent: Vector
    doubt: float
    """Variance by which acceleration that persists makes the attitude uncertain [rad²]."""
    age: float


class MeanField(NamedTuple):
    """Magnetic field since the last step."""

    disturbance: Vector
    """Mean field less the reference, world [T]."""
    east: float
    """Sine of the angle of the field east of magnetic north."""
    variance: float
    """Of that angle [rad²]; −1: no field, or unlike the reference."""
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
    """Measurements of a step."""

    force: MeanForce
    field: MeanField
    rest: RestBias


@inline
def no_integrals() -> Integrals:
    """Return the integrals right after a step."""
    return Integrals(
        elapsed=0.0,
        turned=(ZERO, ZERO, ZERO),
        force=ZERO,
        field=ZERO,
        fields=0,
        angle=0.0,
        rotation=ZERO,
        gaps=0.0,
    )


@inline
def no_averages() -> AveragingState:
    """Return the state before any sample."""
    return AveragingState(
        integrals=no_integrals(),
        rate=ZERO,
        mean_rate=ZERO,
        rate_change=0.0,
        power=0.0,
        smoothed=ZERO,
        persistent=ZERO,
        deviation=0.0,
        age=0.0,
        rest=start_rest(ZERO, ZERO, ZERO),
        reference=no_reference(),
        since_field=0.0,
    )


@inline
def start_averages(
    before: AveragingState, params: AveragingParams, seen: CheckedSample, flags: int
) -> AveragingState:
    """Return the state at the first sample; a known field is remembered over gaps."""
    return AveragingState(
        integrals=no_integrals(),
        rate=seen.angular_velocity,
        mean_rate=seen.angular_velocity,
        rate_change=0.0,
        power=START_POWER * params.slow_weight,
        smoothed=ZERO,
        persistent=ZERO,
        deviation=before.deviation,
        age=0.0,
        rest=start_rest(seen.angular_velocity, seen.linear_acceleration, seen.magnetic_field),
        reference=no_reference() if flags & JUMPED_BACK else before.reference,
        since_field=0.0,
    )


@inline
def integrate(q: Quaternion, bias: Vector, before: Vector, seen: CheckedSample) -> Quaternion:
    """Return the attitude carried on by the mean of this rate and the one before it."""
    rate = subtract(scale(0.5, add(before, seen.angular_velocity)), bias)
    return normalised(multiply(q, from_rotation_vector(scale(seen.interval, rate))))


@inline
def held(
    q: Quaternion, bias: Vector, covariance: Symmetric, state: AveragingState, interval: float
) -> tuple[Quaternion, Symmetric]:
    """Return attitude and covariance carried on by the last rate while there is none [s]."""
    rate = subtract(state.rate, bias)
    grown = HELD * state.rate_change * (interval * interval) * (interval * interval)
    c = covariance
    return (
        normalised(multiply(q, from_rotation_vector(scale(interval, rate)))),
        (c[0] + grown, c[1], c[2], c[3] + grown, c[4], c[5] + grown),
    )


@inline
def accumulate(
    state: AveragingState,
    params: AveragingParams,
    seen: CheckedSample,
    q: Quaternion,
    bias: Vector,
) -> AveragingState:
    """Return the state with a sample added to the integrals, its attitude as predicted."""
    rest = state.rest
    if seen.has_force:
        rest = update_rest(rest, params.rest, seen, bias)
    return AveragingState(
        integrals=_add(state.integrals, seen, q),
        rate=seen.angular_velocity,
        mean_rate=state.mean_rate,
        rate_change=state.rate_change,
        power=state.power,
        smoothed=state.smoothed,
        persistent=state.persistent,
        deviation=state.deviation,
        age=state.age,
        rest=rest,
        reference=state.reference,
        since_field=state.since_field,
    )


@inline
def _add(before: Integrals, seen: CheckedSample, q: Quaternion) -> Integrals:
    """Return the integrals with a sample added, turned to the world by the attitude."""
    rows, dt = matrix(q), seen.interval
    force, field = before.force, before.field
    if seen.has_force:
        force = add(force, scale(dt, transform(rows, seen.linear_acceleration)))
    if seen.has_field:
        field = add(field, transform(rows, seen.magnetic_field))
    w = seen.angular_velocity
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
        angle=before.angle + dt * dot(w, w),
        rotation=add(before.rotation, scale(dt, w)),
        gaps=before.gaps + (dt * dt) * (dt * dt),
    )


@inline
def is_step_due(state: AveragingState, params: AveragingParams) -> bool:
    """Whether the interval between steps has passed."""
    return state.integrals.elapsed >= params.interval


@inline
def angle_variance(state: AveragingState, params: AveragingParams) -> float:
    """Return the variance that the gyroscope's noise added since the last step [rad²].

    At rest it is measured, as the rate's variance times the sample interval, where that is larger.
    """
    past = state.integrals
    density = params.angle_random_walk * params.angle_random_walk
    if state.rest.duration >= params.rest.duration:
        interval = (past.gaps / past.elapsed) ** (1.0 / 3.0)
        density = max(density, state.rest.angular_velocity_variance / 3.0 * interval)
    walk = density * past.elapsed
    scale_error = params.rate_error * params.rate_error * past.angle
    return walk + scale_error + BRIDGE * _rate_change(state) * past.gaps


@inline
def _rate_change(state: AveragingState) -> float:
    """Return the mean square of the change of rate per second, this step's included."""
    t = state.integrals.elapsed
    change = subtract(scale(1.0 / t, state.integrals.rotation), state.mean_rate)
    gain = min(t / 2.0, 0.5)
    return state.rate_change + gain * (dot(change, change) / (t * t) - state.rate_change)


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
    is_unsettled = force.doubt > 0.0 or tilt > UNSETTLED_TILT * UNSETTLED_TILT
    is_new = is_unsettled and state.reference.agreed_for < RELEARNED
    reference = no_reference() if is_new else state.reference
    return Means(
        force=force,
        field=_mean_field(state, params, orientation, reference),
        rest=_bias_at_rest(state, params, bias, rows, bias_covariance, flags),
    )


@inline
def _mean_force(
    state: AveragingState, params: AveragingParams, orientation: Symmetric
) -> MeanForce:
    """Return the mean specific force; its variance follows the acceleration's power.

    What the low-pass leaves counts as acceleration where the tilt's own variance does not
    explain it. A rotation by a large angle is known to half of its square, as it is linearised.
    """
    t = state.integrals.elapsed
    force = scale(1.0 / t, state.integrals.force)
    power, age, variance, doubt = state.power, state.age, -1.0, 0.0
    smoothed, persistent = state.smoothed, state.persistent
    if dot(force, force) > 0.0:
        bridged = BRIDGE * _rate_change(state) * state.integrals.gaps
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
        power += (now - power) * t / (params.acceleration_memory + t)
        density = params.acceleration_floor * params.acceleration_floor + max(power, now)
        variance = density / min(t, params.interval)
        persistent = approach(persistent, force, t / (min(PERSISTENCE, age - t) + t))
        doubt = _doubt(persistent, params.up, 0.5 * tilt + density / min(PERSISTENCE, age))
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
        doubt=doubt if age > LEAST_AGE else 0.0,
        age=age,
    )


@inline
def _doubt(persistent: Vector, up: float, variance: float) -> float:
    """Return the square of the tilt that a mean force shows [rad²], 0 where it is no surprise."""
    x, y = _level_part(persistent, up)
    square = x * x + y * y
    surprise = square > PERSISTENCE_FACTOR * 2.0 * variance
    return square / (GRAVITY * GRAVITY) if surprise else 0.0


@inline
def _level_part(force: Vector, up: float) -> tuple[float, float]:
    """Return the horizontal part of a force; of a right angle's length where it points down."""
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

    A tilt turns the horizontal part of a field that dips: the heading is not known better.
    """
    past, north, deviation = state.integrals, params.north, state.deviation
    if past.fields == 0:
        return MeanField(
            disturbance=ZERO,
            east=0.0,
            variance=-1.0,
            deviation=deviation,
            reference=known,
        )
    since = state.since_field + past.elapsed
    mean = scale(1.0 / past.fields, past.field)
    level = sqrt(mean[0] * mean[0] + mean[1] * mean[1])
    rate = sqrt(past.angle / past.elapsed)
    parts = (level, -params.up * mean[2])
    sine = _east(mean, level, north)
    possible = POSSIBLE_SIGMAS * POSSIBLE_SIGMAS * orientation[5]
    contradicts = sine * sine > possible + POSSIBLE_ANGLE * POSSIBLE_ANGLE
    reference = update_reference(known, params.field, parts, rate, since, contradicts)
    expected = reference.reference
    disturbance = (
        mean[0] - expected[0] * north[0],
        mean[1] - expected[0] * north[1],
        mean[2] + params.up * expected[1],
    )
    if not is_accepted(reference, params.field) or level <= 1e-3 * abs(mean[2]):
        return MeanField(
            disturbance=disturbance,
            east=0.0,
            variance=-1.0,
            deviation=deviation,
            reference=reference,
        )
    gap = level - expected[0]
    now = 0.5 * (gap * gap + disturbance[2] * disturbance[2]) / (level * level)
    deviation += (now - deviation) * since / (params.field_memory + since)
    noise = params.heading_noise * params.heading_noise
    variance = (noise + params.field_weight * max(deviation, now)) / since
    slope = mean[2] / level
    tilt, heading = 0.5 * slope * slope * (orientation[0] + orientation[3]), orientation[5]
    variance += tilt * heading / max(heading - tilt, LEAST_GAIN * heading)
    variance += 0.25 * (sine * sine) * (sine * sine)
    return MeanField(
        disturbance=disturbance,
        east=sine,
        variance=variance,
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

    With six axes nothing tells a steady turn about the vertical from a bias: what is learned
    about it is not known better than it differs from what was known.
    """
    rest = state.rest
    learns = params.learn_bias and is_bias(rest, params.rest)
    if not learns or _rest_flags(rest, params) != AT_REST:
        return RestBias(directions=rows, error=ZERO, variance=(-1.0, -1.0, -1.0))
    undetected = 0.25 * DETECTABLE_TURN / rest.duration
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
def after_step(state: AveragingState, means: Means, turn: Quaternion) -> AveragingState:
    """Return the state with nothing accumulated, the smoothed force turned as the attitude was."""
    past, rows = state.integrals, matrix(turn)
    return AveragingState(
        integrals=no_integrals(),
        rate=state.rate,
        mean_rate=scale(1.0 / past.elapsed, past.rotation),
        rate_change=_rate_change(state),
        power=means.force.power,
        smoothed=transform(rows, means.force.smoothed),
        persistent=transform(rows, means.force.persistent),
        deviation=means.field.deviation,
        age=means.force.age,
        rest=state.rest,
        reference=means.field.reference,
        since_field=0.0 if past.fields else state.since_field + past.elapsed,
    )


@inline
def doubts(state: AveragingState, means: Means, params: AveragingParams) -> tuple[float, float]:
    """Return the variances by which inclination and heading are less certain than they were.

    Because acceleration persists, or a new field was adopted [rad²]: the heading is set anew
    where the reference before had been seen for less than an adoption takes.
    """
    reference, tilt = means.field.reference, means.force.doubt
    if not reference.adopted or state.reference.adopted:
        return tilt, tilt
    turn = tilt + ADOPTION_DOUBT * ADOPTION_DOUBT
    if state.reference.agreed_for < params.field.adoption:
        turn += means.field.east * means.field.east
    return tilt, turn


@inline
def averaging_flags(
    state: AveragingState, params: AveragingParams, disturbance: float, has_field: bool
) -> int:
    """Return AT_REST, BIAS_LIMITED, DISTURBED, JAMMED; `disturbance` [T]."""
    flags = _rest_flags(state.rest, params)
    reference = state.reference
    strength = norm_of(reference)
    if strength > 0.0 and not is_accepted(reference, params.field):
        flags |= DISTURBED
    if has_field and disturbance > 2.0 * strength:
        flags |= JAMMED
    return flags


@inline
def _rest_flags(rest: RestState, params: AveragingParams) -> int:
    """Return AT_REST, and BIAS_LIMITED where the rate is too large for a bias."""
    if rest.duration < params.rest.duration:
        return 0
    mean, limit = rest.angular_velocity, params.rest.bias_limit
    return AT_REST | BIAS_LIMITED if dot(mean, mean) > limit * limit else AT_REST
