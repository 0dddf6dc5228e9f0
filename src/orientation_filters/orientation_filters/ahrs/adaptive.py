# SPDX-License-Identifier: Apache-2.0
"""Adaptive Kalman step of the AHRS, on means between steps.

The errors are those of the indirect filter (orientation, bias, linear acceleration, magnetic
disturbance). Here the orientation error is about the world's axes, and its correlation with the
bias is kept, so that the bias is learned in motion too. Linear acceleration and disturbance are
white from step to step, with variances taken from the means (`step_averages`).
"""

from __future__ import annotations

from math import sqrt

from orientation_filters.ahrs.covariance import (
    Errors,
    JointCovariance,
    independent,
    observe,
    predict,
    widen,
    with_independent_bias,
)
from orientation_filters.ahrs.state import MICROTESLA_PER_TESLA, AdaptiveKalmanState, Params, State
from orientation_filters.kernel import inline
from orientation_filters.magnetic_reference import FieldState, norm_of
from orientation_filters.rotation.scalars import (
    ZERO,
    ZERO_SYMMETRIC,
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
from orientation_filters.sample_checks import GRAVITY, CheckedSample
from orientation_filters.step_averages.accumulation import (
    UNKNOWN_HEADING_VARIANCE,
    AveragingParams,
    AveragingState,
    accumulate,
    angle_variance,
    averaging_flags,
    bias_variance,
    is_step_due,
    start_averages,
)
from orientation_filters.step_averages.means import (
    Means,
    added_variances,
    after_step,
    shown_covariance,
    take_means,
)


@inline
def start_adaptive(
    state: AdaptiveKalmanState, params: AveragingParams, seen: CheckedSample, flags: int
) -> AdaptiveKalmanState:
    """Return the state at the first sample; a known field is remembered over gaps."""
    heading = params.initial_heading**2 if seen.has_field else UNKNOWN_HEADING_VARIANCE
    covariance = independent(params.initial_inclination**2, heading, params.initial_bias**2)
    return AdaptiveKalmanState(
        covariance=covariance,
        shown=covariance.orientation,
        averages=start_averages(state.averages, params, seen, flags),
    )


@inline
def adaptive_update(
    state: State, params: Params, seen: CheckedSample, predicted: Quaternion, flags: int
) -> tuple[State, int]:
    """Return state and flags after a sample; every `interval` the errors are estimated."""
    state = add_sample(state, params, seen, predicted)
    if is_step_due(state.adaptive.averages, params.averaging):
        prior, means = measurements(state, params, flags)
        errors = estimate_errors(prior, means, params.up)
        state = remove_errors(state, params, means, errors)
    return state, flags | adaptive_flags(state, params, seen)


@inline
def add_sample(state: State, params: Params, seen: CheckedSample, predicted: Quaternion) -> State:
    """Return the state with a sample added to the means."""
    before = state.adaptive
    averages = accumulate(before.averages, params.averaging, seen, predicted, state.bias)
    return State(
        stamp=seen.stamp,
        orientation=predicted,
        bias=state.bias,
        linear_acceleration=state.linear_acceleration,
        magnetic_disturbance=state.magnetic_disturbance,
        dip=state.dip,
        variances=state.variances,
        slow=state.slow,
        updates=state.updates,
        field_stamp=seen.stamp if seen.has_field else state.field_stamp,
        adaptive=AdaptiveKalmanState(
            covariance=before.covariance, shown=before.shown, averages=averages
        ),
    )


@inline
def measurements(state: State, params: Params, flags: int) -> tuple[JointCovariance, Means]:
    """Return the predicted covariance, and the means since the last step with their variances."""
    averages = state.adaptive.averages
    prior = _predict(state.adaptive.covariance, averages, params)
    means = take_means(
        averages,
        params.averaging,
        state.bias,
        matrix(state.orientation),
        prior.orientation,
        prior.bias,
        flags,
    )
    tilt, turn = added_variances(averages, means, params.averaging)
    return widen(prior, tilt, turn), means


@inline
def _predict(known: JointCovariance, averages: AveragingState, params: Params) -> JointCovariance:
    """Return the covariance after the time since the last step."""
    past = averages.integrals
    minus = (
        scale(-1.0, past.turned[0]),
        scale(-1.0, past.turned[1]),
        scale(-1.0, past.turned[2]),
    )
    drift = bias_variance(averages, params.averaging)
    if not params.learn_bias:
        known, drift = with_independent_bias(known, ZERO_SYMMETRIC), 0.0
    return predict(known, minus, angle_variance(averages, params.averaging), drift)


@inline
def estimate_errors(prior: JointCovariance, means: Means, up: float) -> Errors:
    """Return the errors after all measurements, one after the other."""
    errors = Errors(orientation=ZERO, bias=ZERO, covariance=prior)
    if means.force.variance > 0.0:
        pull, a, r = up * GRAVITY, means.force.acceleration, means.force.variance
        errors = observe(errors, (0.0, pull, 0.0), ZERO, a[0], r)
        errors = observe(errors, (-pull, 0.0, 0.0), ZERO, a[1], r)
    if means.field.variance > 0.0:
        errors = observe(errors, (0.0, 0.0, -1.0), ZERO, means.field.east, means.field.variance)
    d, e, r3 = means.rest.directions, means.rest.error, means.rest.variance
    if r3[0] > 0.0:
        errors = observe(errors, ZERO, d[0], e[0], r3[0])
        errors = observe(errors, ZERO, d[1], e[1], r3[1])
        if r3[2] > 0.0:
            errors = observe(errors, ZERO, d[2], e[2], r3[2])
    return errors


@inline
def remove_errors(state: State, params: Params, means: Means, errors: Errors) -> State:
    """Return the state with the estimated errors subtracted and the sums of the step cleared."""
    turn = from_rotation_vector(scale(-1.0, errors.orientation))
    q = normalised(multiply(turn, state.orientation))
    rows = matrix(q)
    before = state.adaptive
    disturbance, dip = state.magnetic_disturbance, state.dip
    if before.averages.integrals.fields > 0:
        disturbance = scale(MICROTESLA_PER_TESLA, to_sensor(rows, means.field.disturbance))
        dip = _dip_of(means.field.reference, dip)
    covariance = errors.covariance
    if not params.learn_bias:
        covariance = with_independent_bias(covariance, before.covariance.bias)
    return State(
        stamp=state.stamp,
        orientation=q,
        bias=subtract(state.bias, errors.bias),
        linear_acceleration=to_sensor(rows, _remaining_acceleration(means, errors, params.up)),
        magnetic_disturbance=disturbance,
        dip=dip,
        variances=state.variances,
        slow=state.slow,
        updates=state.updates + 1,
        field_stamp=state.field_stamp,
        adaptive=AdaptiveKalmanState(
            covariance=covariance,
            shown=shown_covariance(covariance.orientation, means, params.averaging),
            averages=after_step(before.averages, means, turn),
        ),
    )


@inline
def _remaining_acceleration(means: Means, errors: Errors, up: float) -> Vector:
    """Return the acceleration that the errors do not explain, world [m/s²]."""
    a, turn, pull = means.force.acceleration, errors.orientation, up * GRAVITY
    return a[0] - pull * turn[1], a[1] + pull * turn[0], a[2]


@inline
def _dip_of(reference: FieldState, before: tuple[float, float]) -> tuple[float, float]:
    """Return cosine and sine of the reference's inclination."""
    flat, sunk = reference.reference
    length = norm_of(reference)
    return (flat / length, sunk / length) if length > 0.0 else before


@inline
def adaptive_flags(state: State, params: Params, seen: CheckedSample) -> int:
    """Return AT_REST, BIAS_LIMITED, DISTURBED, JAMMED as they stand after a sample."""
    d = state.magnetic_disturbance
    strength = sqrt(dot(d, d)) / MICROTESLA_PER_TESLA
    return averaging_flags(state.adaptive.averages, params.averaging, strength, seen.has_field)
