# SPDX-License-Identifier: Apache-2.0
"""Adaptive complementary filter: corrections from means, with gains that follow the covariance.

Each of the three rotations about the world's axes has a first-order filter of its own; its gain
is the attitude's variance over that of attitude and measurement. The attitude's variance is noise
plus the effect of the bias error: the matrix `lag` is the attitude error per unit of bias error.
Through it each correction also corrects the bias, and takes back the rotation that the bias error
has caused. Undisturbed and settled, the gains are those of the fixed-gain filter's cut-off
frequencies.
"""

from __future__ import annotations

from typing import NamedTuple

from orientation_filters.kernel import inline
from orientation_filters.rotation.scalars import (
    ZERO,
    ZERO_SYMMETRIC,
    Matrix,
    Quaternion,
    Symmetric,
    Vector,
    add,
    apply_symmetric,
    dot,
    from_rotation_vector,
    less,
    matrix,
    multiply,
    normalised,
    scale,
    subtract,
)
from orientation_filters.sample_checks import GRAVITY, CheckedSample
from orientation_filters.step_averages.accumulation import (
    UNKNOWN_HEADING_VARIANCE,
    AveragingParams,
    AveragingState,
    accumulate,
    angle_variance,
    bias_variance,
    is_step_due,
    no_averages,
    start_averages,
)
from orientation_filters.step_averages.means import (
    Means,
    added_variances,
    after_step,
    shown_covariance,
    take_means,
)


class Unknowns(NamedTuple):
    """Joint covariance of attitude and bias: attitude error = noise + lag · bias error."""

    noise: Vector
    """Variances of the part independent of the bias, about the world's axes [rad²]."""
    lag: Matrix
    """Attitude error per unit of bias error [s]; rows world, columns sensor."""
    bias: Symmetric
    """Covariance of the bias, sensor [(rad/s)²]."""


class AdaptiveGainState(NamedTuple):
    """State of the adaptive filter besides attitude and bias."""

    averages: AveragingState
    unknowns: Unknowns
    covariance: Symmetric
    """Of the orientation error about the world's axes after the last step [rad²]."""
    shown: Symmetric
    """The same with the variance factors [rad²]."""


class StepErrors(NamedTuple):
    """Errors estimated so far in a step, and the joint covariance that remains."""

    orientation: Vector
    """About the world's axes [rad]."""
    bias: Vector
    """Sensor frame [rad/s]."""
    unknowns: Unknowns


@inline
def no_adaptation() -> AdaptiveGainState:
    """Return the state before any sample."""
    unknowns = Unknowns(noise=ZERO, lag=(ZERO, ZERO, ZERO), bias=ZERO_SYMMETRIC)
    return AdaptiveGainState(
        averages=no_averages(), unknowns=unknowns, covariance=ZERO_SYMMETRIC, shown=ZERO_SYMMETRIC
    )


@inline
def start_adaptive(
    state: AdaptiveGainState, params: AveragingParams, seen: CheckedSample, flags: int
) -> AdaptiveGainState:
    """Return the state at the first sample; a known field is remembered over gaps."""
    tilt, bias = params.initial_inclination**2, params.initial_bias**2
    turn = params.initial_heading**2 if seen.has_field else UNKNOWN_HEADING_VARIANCE
    unknowns = Unknowns(
        noise=(tilt, tilt, turn),
        lag=(ZERO, ZERO, ZERO),
        bias=(bias, 0.0, 0.0, bias, 0.0, bias),
    )
    covariance = covariance_of(unknowns)
    return AdaptiveGainState(
        averages=start_averages(state.averages, params, seen, flags),
        unknowns=unknowns,
        covariance=covariance,
        shown=covariance,
    )


@inline
def adaptive_step(
    state: AdaptiveGainState,
    params: AveragingParams,
    seen: CheckedSample,
    q: Quaternion,
    bias: Vector,
    flags: int,
) -> tuple[AdaptiveGainState, Quaternion, Vector, float]:
    """Return state, attitude, bias and disturbance [T] (−1: as before) after a sample."""
    averages = accumulate(state.averages, params, seen, q, bias)
    if not is_step_due(averages, params):
        waiting = AdaptiveGainState(
            averages=averages,
            unknowns=state.unknowns,
            covariance=state.covariance,
            shown=state.shown,
        )
        return waiting, q, bias, -1.0
    unknowns = _predict(state.unknowns, averages, params)
    known, rows = covariance_of(unknowns), matrix(q)
    means = take_means(averages, params, bias, rows, known, unknowns.bias, flags)
    found = _correct(unknowns, averages, means, params)
    turn = from_rotation_vector(scale(-1.0, found.orientation))
    d, covariance = means.field.disturbance, covariance_of(found.unknowns)
    return (
        AdaptiveGainState(
            averages=after_step(averages, means, turn),
            unknowns=found.unknowns,
            covariance=covariance,
            shown=shown_covariance(covariance, means, params),
        ),
        normalised(multiply(turn, q)),
        subtract(bias, found.bias),
        dot(d, d) ** 0.5 if averages.integrals.fields > 0 else -1.0,
    )


@inline
def _predict(before: Unknowns, averages: AveragingState, params: AveragingParams) -> Unknowns:
    """Return the joint covariance after the time since the last step.

    The bias's random walk decorrelates it from the attitude error it caused before: that part of
    the lag becomes noise, and the attitude's covariance stays what it was.
    """
    past, b = averages.integrals, before.bias
    walk = angle_variance(averages, params)
    drift = bias_variance(averages, params)
    if not params.learn_bias:
        b, drift = ZERO_SYMMETRIC, 0.0
    n, lag, total = before.noise, before.lag, b[0] + b[3] + b[5]
    keep = total / (total + 3.0 * drift) if drift > 0.0 else 1.0
    freed = 1.0 - keep
    return Unknowns(
        noise=(
            n[0] + walk + freed * dot(lag[0], apply_symmetric(b, lag[0])),
            n[1] + walk + freed * dot(lag[1], apply_symmetric(b, lag[1])),
            n[2] + walk + freed * dot(lag[2], apply_symmetric(b, lag[2])),
        ),
        lag=(
            subtract(scale(keep, lag[0]), past.turned[0]),
            subtract(scale(keep, lag[1]), past.turned[1]),
            subtract(scale(keep, lag[2]), past.turned[2]),
        ),
        bias=(b[0] + drift, b[1], b[2], b[3] + drift, b[4], b[5] + drift),
    )


@inline
def _correct(
    unknowns: Unknowns, averages: AveragingState, means: Means, params: AveragingParams
) -> StepErrors:
    """Return the errors after the measurements of specific force, field and rest in turn."""
    n = unknowns.noise
    tilt, turn = added_variances(averages, means, params)
    found = StepErrors(
        orientation=ZERO,
        bias=ZERO,
        unknowns=Unknowns(
            noise=(n[0] + tilt, n[1] + tilt, n[2] + turn), lag=unknowns.lag, bias=unknowns.bias
        ),
    )
    if means.force.variance > 0.0:
        pull = 1.0 / (params.up * GRAVITY)
        a, variance = means.force.acceleration, means.force.variance * pull * pull
        found = _turn(found, (1.0, 0.0, 0.0), -pull * a[1], variance)
        found = _turn(found, (0.0, 1.0, 0.0), pull * a[0], variance)
    if means.field.variance > 0.0:
        found = _turn(found, (0.0, 0.0, 1.0), -means.field.east, means.field.variance)
    d, e, r = means.rest.directions, means.rest.error, means.rest.variance
    if r[0] > 0.0:
        found = _learn(found, d[0], e[0], r[0])
        found = _learn(found, d[1], e[1], r[1])
        if r[2] > 0.0:
            found = _learn(found, d[2], e[2], r[2])
    return found


@inline
def _turn(found: StepErrors, axis: Vector, angle: float, variance: float) -> StepErrors:
    """Return the errors after a measured angle about one of the world's axes [rad].

    The filter of that axis corrects its noise; the corrected bias turns all three axes through
    `lag` (separate-bias estimation: Friedland, IEEE Trans. Automatic Control 14, 1969).
    """
    before = found.unknowns
    n, lag = before.noise, before.lag
    along_axis = add(add(scale(axis[0], lag[0]), scale(axis[1], lag[1])), scale(axis[2], lag[2]))
    along = apply_symmetric(before.bias, along_axis)
    noise = dot(n, axis)
    weight = 1.0 / (noise + dot(along_axis, along) + variance)
    innovation = weight * (angle - dot(found.orientation, axis))
    change = scale(innovation, along)
    turned = (dot(lag[0], change), dot(lag[1], change), dot(lag[2], change))
    gain = noise / (noise + variance)
    keep = (1.0 - gain * axis[0], 1.0 - gain * axis[1], 1.0 - gain * axis[2])
    return StepErrors(
        orientation=add(found.orientation, add(scale(innovation * noise, axis), turned)),
        bias=add(found.bias, change),
        unknowns=Unknowns(
            noise=(keep[0] * n[0], keep[1] * n[1], keep[2] * n[2]),
            lag=(scale(keep[0], lag[0]), scale(keep[1], lag[1]), scale(keep[2], lag[2])),
            bias=less(before.bias, along, weight),
        ),
    )


@inline
def _learn(found: StepErrors, direction: Vector, error: float, variance: float) -> StepErrors:
    """Return the errors after a measured component of the bias error [rad/s].

    The attitude is turned back by the rotation that this bias error has caused.
    """
    before = found.unknowns
    along = apply_symmetric(before.bias, direction)
    weight = 1.0 / (dot(direction, along) + variance)
    change = scale(weight * (error - dot(direction, found.bias)), along)
    lag = before.lag
    turned = (dot(lag[0], change), dot(lag[1], change), dot(lag[2], change))
    return StepErrors(
        orientation=add(found.orientation, turned),
        bias=add(found.bias, change),
        unknowns=Unknowns(noise=before.noise, lag=lag, bias=less(before.bias, along, weight)),
    )


@inline
def covariance_of(unknowns: Unknowns) -> Symmetric:
    """Return xx, xy, xz, yy, yz, zz of the orientation error about the world's axes [rad²]."""
    n, lag, b = unknowns.noise, unknowns.lag, unknowns.bias
    x, y, z = apply_symmetric(b, lag[0]), apply_symmetric(b, lag[1]), apply_symmetric(b, lag[2])
    return (
        n[0] + dot(lag[0], x),
        dot(lag[0], y),
        dot(lag[0], z),
        n[1] + dot(lag[1], y),
        dot(lag[1], z),
        n[2] + dot(lag[2], z),
    )
