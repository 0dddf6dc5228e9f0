# SPDX-License-Identifier: Apache-2.0
"""Complementary filter: gyroscope above the cut-off, accelerometer and magnetometer below.

The gyroscope's attitude is turned, by the gain g = 1 − exp(−2π f_c Δt) of a first-order low-pass,
towards the attitude at which specific force points up, then about the vertical towards magnetic
north (quaternion form after Valenti, Dryanovski, Xiao, Sensors 15, 2015). `learn_bias` adds rest
detection and bias learning (`fixed_gain`); `adaptive` chooses the filter of that module.
"""

from __future__ import annotations

from typing import Any

from imu_recording.recording import ImuRecording

from orientation_filters.complementary.adaptive import adaptive_step, start_adaptive
from orientation_filters.complementary.fixed_gain import (
    ADAPTIVE_STATE,
    FIXED_STATE,
    Params,
    State,
    correct,
    fixed_gain_covariance,
    heading_correction,
    inclination_correction,
    initial_state,
    learned_bias,
)
from orientation_filters.kernel import inline, kernel
from orientation_filters.rest_detection import start_rest
from orientation_filters.result import (
    DROPPED,
    INVALID_GYROSCOPE,
    JUMPED_BACK,
    NOT_STARTED,
    REINITIALISED,
    SIX_AXIS,
    Estimate,
    OrientationResult,
    ResultColumns,
    empty_result,
)
from orientation_filters.rotation.scalars import (
    IDENTITY,
    UNKNOWN_QUATERNION,
    UNKNOWN_SYMMETRIC,
    UNKNOWN_VECTOR,
    ZERO,
    Quaternion,
    Symmetric,
    Vector,
    attitude_from_vectors,
    matrix,
    normalised,
    scale,
    subtract,
    transform,
    turned_at,
)
from orientation_filters.sample_checks import (
    CheckedSample,
    Sample,
    SampleColumns,
    check_sample,
    sample_columns,
    sample_of,
)
from orientation_filters.slow_attitude import follow, start_slow
from orientation_filters.step_averages.accumulation import averaging_flags, held, integrate

__all__ = ['ADAPTIVE_STATE', 'FIXED_STATE', 'Params', 'State', 'initial_state', 'run', 'update']


@kernel
def update(state: State, params: Params, sample: Sample) -> tuple[State, Estimate]:
    """Return state and estimate after a sample."""
    state, flags = _update(state, params, sample, params.learn_bias, params.adaptive)
    q, covariance = _shown(state, params, sample.stamp, flags, params.adaptive)
    return state, Estimate(orientation=q, covariance=covariance, flags=flags)


@kernel
def step(
    states: Any, params: Any, stamp: int, w: Vector, f: Vector, m: Vector
) -> tuple[Quaternion, Symmetric, int]:
    """Return orientation, covariance and flags after a sample, given as stamp and vectors.

    State and parameters stay in compiled memory (`live.filter`): that takes a tenth of the time.
    """
    states[0], found = update(states[0], params[0], Sample(stamp, w, f, m))
    return found.orientation, found.covariance, found.flags


@inline
def _shown(
    state: State, params: Params, stamp: int, flags: int, adaptive: bool
) -> tuple[Quaternion, Symmetric]:
    """Return attitude and covariance at a stamp [ns], carried on by the last rate without one."""
    if not adaptive:
        return _orientation(state), fixed_gain_covariance(state, params)
    known = state.adaptive
    if not flags & INVALID_GYROSCOPE or stamp <= state.stamp:
        return _orientation(state), known.shown
    interval = 1e-9 * (stamp - state.stamp)
    return held(state.orientation, state.bias, known.shown, known.averages, interval)


@inline
def _update(
    state: State, params: Params, sample: Sample, learns: bool, adaptive: bool
) -> tuple[State, int]:
    """Return state and flags; False for `learns` or `adaptive`, constants, leaves its code out."""
    seen, flags = check_sample(sample, state.stamp, state.field_stamp, params.samples)
    if flags & DROPPED:
        return state, flags
    if flags & REINITIALISED:
        return _start(state, params, seen, flags)
    if adaptive:
        return _adapt(state, params, seen, flags)
    rate = subtract(seen.angular_velocity, state.bias)
    predicted = turned_at(state.orientation, rate, seen.interval)
    rows = matrix(predicted)
    tilt = inclination_correction(params, seen, rows)
    turn = heading_correction(params, seen, rows, tilt.gain)
    corrected = correct(state.orientation, predicted, tilt, turn)
    turned = (tilt.gain * tilt.x, tilt.gain * tilt.y, turn.gain * turn.z)
    if learns:
        turned = subtract(turned, transform(rows, scale(seen.interval, state.bias)))
    rest, bias, rest_flags = learned_bias(state, params, seen, rows, tilt, turn, learns)
    return State(
        stamp=seen.stamp,
        orientation=corrected,
        bias=bias,
        slow=follow(state.slow, seen, rows, turned, (params.up, params.north)),
        age=state.age + seen.interval,
        field_stamp=seen.stamp if seen.has_field else state.field_stamp,
        rest=rest,
        disturbance=state.disturbance,
        adaptive=state.adaptive,
    ), flags | rest_flags


@inline
def _adapt(state: State, params: Params, seen: CheckedSample, flags: int) -> tuple[State, int]:
    """Return state and flags of the adaptive filter after a sample."""
    predicted = integrate(state.orientation, state.bias, state.adaptive.averages, seen)
    adaptive, q, bias, disturbance = adaptive_step(
        state.adaptive, params.averaging, seen, predicted, state.bias, flags
    )
    disturbance = disturbance if disturbance >= 0.0 else state.disturbance
    flags |= averaging_flags(adaptive.averages, params.averaging, disturbance, seen.has_field)
    return State(
        stamp=seen.stamp,
        orientation=q,
        bias=bias,
        slow=state.slow,
        age=state.age + seen.interval,
        field_stamp=seen.stamp if seen.has_field else state.field_stamp,
        rest=state.rest,
        disturbance=disturbance,
        adaptive=adaptive,
    ), flags


@inline
def _start(state: State, params: Params, seen: CheckedSample, flags: int) -> tuple[State, int]:
    """Set the attitude from one specific force and field; only a jump back resets the bias."""
    f, m = seen.linear_acceleration, seen.magnetic_field
    if not seen.has_field:
        flags |= SIX_AXIS
    if not seen.has_force:
        flags |= NOT_STARTED
    q = attitude_from_vectors(f, m, params.up, params.north) if seen.has_force else IDENTITY
    adaptive = state.adaptive
    if params.adaptive:
        adaptive = start_adaptive(adaptive, params.averaging, seen, flags)
    return State(
        stamp=seen.stamp if seen.has_force else -1,
        orientation=q if seen.has_force else state.orientation,
        bias=ZERO if flags & JUMPED_BACK else state.bias,
        slow=start_slow(),
        age=0.0,
        field_stamp=seen.stamp if seen.has_force and seen.has_field else -1,
        rest=start_rest(seen.angular_velocity, f, m),
        disturbance=0.0,
        adaptive=adaptive,
    ), flags


@inline
def _orientation(state: State) -> Quaternion:
    """Return the attitude, sensor → world, of unit length, w ≥ 0."""
    q = state.orientation
    excess = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0
    if abs(excess) > 1e-4:
        return normalised(q)
    factor = 1.0 + excess * (0.375 * excess - 0.5)  # 1/√(1 + excess) to 3e-13
    if q[3] < 0.0:
        factor = -factor
    return q[0] * factor, q[1] * factor, q[2] * factor, q[3] * factor


def run(
    recording: ImuRecording,
    params: Params,
    *,
    details: bool = False,  # noqa: ARG001 (every filter's interface)
) -> OrientationResult:
    """Return attitude, covariance, bias and flags of every row; there are no `details`."""
    result = empty_result(recording.stamp, covariances=6 if params.adaptive else 2)
    _run(initial_state(), params, sample_columns(recording), result.columns())
    return result


@kernel
def _run(state: State, params: Params, samples: SampleColumns, result: ResultColumns) -> None:
    if params.adaptive:
        _loop(state, params, samples, result, True, True)
    elif params.learn_bias:
        _loop(state, params, samples, result, True, False)
    else:
        _loop(state, params, samples, result, False, False)


@inline
def _loop(
    state: State,
    params: Params,
    samples: SampleColumns,
    result: ResultColumns,
    learns: bool,
    adaptive: bool,
) -> None:
    """Go over the rows; compiled once for each pair of the constants `learns`, `adaptive`."""
    for i in range(len(samples.stamp)):
        state, flags = _update(state, params, sample_of(samples, i), learns, adaptive)
        if flags:
            result.flags[i] = flags
        started = not flags & NOT_STARTED
        q, c = _shown(state, params, samples.stamp[i], flags, adaptive)
        q, c = (q, c) if started else (UNKNOWN_QUATERNION, UNKNOWN_SYMMETRIC)
        b = state.bias if started else UNKNOWN_VECTOR
        for k in range(4):
            result.orientation[i, k] = q[k]
        if adaptive:
            for k in range(6):
                result.compact_covariance[i, k] = c[k]
        else:
            result.compact_covariance[i, 0] = c[0]
            result.compact_covariance[i, 1] = c[5]
        if learns or flags:
            for k in range(3):
                result.bias[i, k] = b[k]
