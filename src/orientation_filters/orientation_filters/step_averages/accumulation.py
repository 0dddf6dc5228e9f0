# SPDX-License-Identifier: Apache-2.0
"""Samples added up over short steps in the world frame: attitude, specific force and field.

Both robust filters use it. Between steps, `interval` apart, the gyroscope alone carries the
attitude, its rate a parabola from sample to sample, a straight line over gaps. Specific force and
field are averaged in the world frame, where gravity and the Earth's field stand still and
accelerations largely cancel. `means` turns the averages into measurements with variances.
"""

from __future__ import annotations

from typing import NamedTuple

from orientation_filters.kernel import inline
from orientation_filters.magnetic_reference import (
    FieldParams,
    FieldState,
    is_accepted,
    no_reference,
    norm_of,
)
from orientation_filters.rest_detection import RestParams, RestState, start_rest, update_rest
from orientation_filters.result import AT_REST, BIAS_LIMITED, DISTURBED, JAMMED, JUMPED_BACK
from orientation_filters.rotation.scalars import (
    ZERO,
    Matrix,
    Quaternion,
    Symmetric,
    Vector,
    add,
    cross,
    dot,
    from_rotation_vector,
    matrix,
    multiply,
    normalised,
    scale,
    subtract,
    transform,
    turned_at,
)
from orientation_filters.sample_checks import CheckedSample
from orientation_filters.step_averages.variance_factors import VarianceFactors, no_factors

UNKNOWN_HEADING_VARIANCE = 3.29
"""Variance of a heading that may be anything: π² / 3 [rad²]."""
START_POWER = 4.0
"""Mean square of the acceleration assumed at the start, per axis [(m/s²)²]."""
INTERPOLATION_FACTOR = 1 / 16
"""Variance of an angle whose rate was interpolated linearly over a gap h, in units of
(change of rate per second)² h⁴."""
EXTRAPOLATION_FACTOR = 1 / 4
"""Variance of an angle carried on by the last rate over h, in the same units."""


class AveragingParams(NamedTuple):
    """Noise densities and time constants of the means; none depends on the sample rate."""

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
    """How much of the power left after the low-pass counts as density [s]."""
    acceleration_memory: float
    """Time constant of the mean of both powers [s]."""
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
    variance_factors: bool
    """Whether the covariance shown is scaled by them."""
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
    """State of the means from sample to sample and from step to step."""

    integrals: Integrals
    rate: Vector
    """Angular velocity of the last sample [rad/s], sensor frame."""
    change: Vector
    """Its change since the sample before [rad/s]."""
    interval: float
    """Between those two samples [s]."""
    mean_rate: Vector
    """Of the last step [rad/s], sensor frame."""
    rate_change: float
    """Running mean of the square of the change of rate per second [(rad/s²)²]."""
    power: float
    """Running mean of the density of specific force's error from acceleration [(m/s²)² s]."""
    smoothed: Vector
    """Specific force after its low-pass, world [m/s²]."""
    persistent: Vector
    """Mean specific force over `PERSISTENCE_S`, world [m/s²]."""
    deviation: float
    """Running mean square of the field's distance from the reference, per part, as a part of its
    horizontal part."""
    age: float
    """Since the start, of steps with a specific force [s]."""
    rest: RestState
    reference: FieldState
    since_field: float
    """Time since the last step with a field [s]."""
    factors: VarianceFactors


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
        change=ZERO,
        interval=0.0,
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
        factors=no_factors(),
    )


@inline
def start_averages(
    before: AveragingState, params: AveragingParams, seen: CheckedSample, flags: int
) -> AveragingState:
    """Return the state at the first sample; a known field is remembered over gaps."""
    return AveragingState(
        integrals=no_integrals(),
        rate=seen.angular_velocity,
        change=ZERO,
        interval=0.0,
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
        factors=no_factors(),
    )


@inline
def integrate(
    q: Quaternion, bias: Vector, before: AveragingState, seen: CheckedSample
) -> Quaternion:
    """Return the attitude carried on by the rate, a parabola through this sample and two before.

    The rotation vector is the parabola's integral and the term of a turning axis (Bortz, IEEE
    Trans. Aerospace and Electronic Systems 7, 1971). Where the interval before was shorter the
    parabola's curvature, which noise would dominate, has less weight.
    """
    h, past = seen.interval, before.interval
    first, last = subtract(before.rate, bias), subtract(seen.angular_velocity, bias)
    bend, longer = h / 12.0, 1.0
    if h != past:
        longer = h / past if past > 0.0 else 0.0
        bend = h * min(h, past) / (6.0 * (h + past))
    bent = scale(bend, subtract(subtract(last, first), scale(longer, before.change)))
    coning = scale(h * h / 12.0, cross(first, last))
    turn = add(subtract(scale(0.5 * h, add(first, last)), bent), coning)
    return _carried(q, from_rotation_vector(turn))


@inline
def _carried(q: Quaternion, turn: Quaternion) -> Quaternion:
    """Return an attitude turned in the sensor's frame, w ≥ 0, of unit length to rounding.

    It is rescaled by the squared length of `q`, to first order: the next sample does not have to
    wait for a square root.
    """
    x, y, z, w = multiply(q, turn)
    factor = 1.5 - 0.5 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if w < 0.0:
        factor = -factor
    return x * factor, y * factor, z * factor, w * factor


@inline
def held(
    q: Quaternion, bias: Vector, covariance: Symmetric, state: AveragingState, interval: float
) -> tuple[Quaternion, Symmetric]:
    """Return attitude and covariance `interval` [s] after the last rate, which is held."""
    rate = subtract(state.rate, bias)
    grown = (
        EXTRAPOLATION_FACTOR * state.rate_change * (interval * interval) * (interval * interval)
    )
    c = covariance
    return (
        normalised(turned_at(q, rate, interval)),
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
        change=subtract(seen.angular_velocity, state.rate),
        interval=seen.interval,
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
        factors=state.factors,
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
def bias_variance(state: AveragingState, params: AveragingParams) -> float:
    """Return the variance that the bias's random walk added since the last step [(rad/s)²]."""
    return params.bias_random_walk * params.bias_random_walk * state.integrals.elapsed


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
    return walk + scale_error + INTERPOLATION_FACTOR * rate_change(state) * past.gaps


@inline
def rate_change(state: AveragingState) -> float:
    """Return the mean square of the change of rate per second, this step's included."""
    t = state.integrals.elapsed
    change = subtract(scale(1.0 / t, state.integrals.rotation), state.mean_rate)
    gain = min(t / 2.0, 0.5)
    return state.rate_change + gain * (dot(change, change) / (t * t) - state.rate_change)


@inline
def averaging_flags(
    state: AveragingState, params: AveragingParams, disturbance: float, has_field: bool
) -> int:
    """Return AT_REST, BIAS_LIMITED, DISTURBED, JAMMED; `disturbance` [T]."""
    flags = rest_flags(state.rest, params)
    reference = state.reference
    strength = norm_of(reference)
    if strength > 0.0 and not is_accepted(reference, params.field):
        flags |= DISTURBED
    if has_field and disturbance > 2.0 * strength:
        flags |= JAMMED
    return flags


@inline
def rest_flags(rest: RestState, params: AveragingParams) -> int:
    """Return AT_REST, and BIAS_LIMITED where the rate is too large for a bias."""
    if rest.duration < params.rest.duration:
        return 0
    mean, limit = rest.angular_velocity, params.rest.bias_limit
    return AT_REST | BIAS_LIMITED if dot(mean, mean) > limit * limit else AT_REST
