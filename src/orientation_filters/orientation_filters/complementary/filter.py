# SPDX-License-Identifier: Apache-2.0
"""Complementary filter: gyroscope above the cut-off, accelerometer and magnetometer below.

The gyroscope's attitude is turned, by the gain g = 1 − exp(−2π f_c Δt) of a first-order low-pass,
towards the attitude at which specific force points up, then about the vertical towards magnetic
north (quaternion form after Valenti, Dryanovski, Xiao, Sensors 15, 2015). `learn_bias` adds rest
detection and bias learning; `adaptive` is a filter of its own, see there.
"""

from __future__ import annotations

from math import exp, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from imu_recording.recording import ImuRecording

from orientation_filters.averages import AveragingParams, averaging_flags, held, integrate
from orientation_filters.complementary.adaptive import (
    AdaptiveState,
    adaptive_step,
    no_adaptation,
    start_adaptive,
)
from orientation_filters.kernel import inline, kernel
from orientation_filters.rest_detection import (
    RestParams,
    RestState,
    is_bias,
    start_rest,
    update_rest,
)
from orientation_filters.result import (
    AT_REST,
    BIAS_LIMITED,
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
    ZERO,
    Matrix,
    Quaternion,
    Symmetric,
    Vector,
    approach,
    attitude_from_vectors,
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
from orientation_filters.sample_checks import (
    GRAVITY,
    CheckedSample,
    Sample,
    SampleColumns,
    SampleParams,
    check_sample,
    sample_columns,
    sample_of,
)

PER_GRAVITY = 1.0 / GRAVITY
NAN3 = (np.nan,) * 3
NAN4 = (np.nan,) * 4
NAN6 = (np.nan,) * 6


class Params(NamedTuple):
    """Numbers the kernel needs; `ComplementaryParameters` names them with units."""

    up: float
    """World z of the upward direction: +1 ENU, −1 NED."""
    north: tuple[float, float]
    """World x, y of magnetic north (unit vector)."""
    inclination_rate: float
    """2π × cut-off of the accelerometer's correction [rad/s]."""
    heading_rate: float
    """2π × cut-off of the magnetometer's correction [rad/s]."""
    angle_random_walk: float
    """[rad/√s]"""
    bias_sigma: float
    """Gyroscope bias left over, standard deviation [rad/s]."""
    inclination_sigma: float
    """Error of one specific force as a vertical [rad]."""
    heading_sigma: float
    """Error of one magnetic field as a heading [rad]."""
    adaptive: bool
    learn_bias: bool
    bias_rate: float
    """Integral gain in motion, as a part of rate² [1]."""
    rest_bias_time: float
    """Time constant of bias learning at rest [s]."""
    samples: SampleParams
    rest: RestParams
    averaging: AveragingParams


class State(NamedTuple):
    """What one sample leaves for the next."""

    stamp: int
    """Of the last sample used [ns]; −1 before the first."""
    orientation: Quaternion
    """Of nearly unit length; `Estimate` gives it exactly."""
    bias: Vector
    """Of the gyroscope [rad/s], sensor frame."""
    variance: tuple[float, float]
    """Of inclination and heading from noise [rad²]."""
    lag: tuple[float, float]
    """Error of inclination and heading from a bias of one standard deviation [rad]."""
    age: float
    """Since the attitude was set [s]."""
    field_stamp: int
    """Of the last magnetometer sample [ns]; −1 before the first."""
    rest: RestState
    disturbance: float
    """Distance of the field from the reference [T], adaptive."""
    adaptive: AdaptiveState


class InclinationCorrection(NamedTuple):
    """Rotation about the world's x and y that the accelerometer asks for."""

    x: float
    """To specific force upward [rad]."""
    y: float
    gain: float
    """Part of the rotation that is done."""
    sigma: float
    """Error of the sample as a vertical [rad]."""


class HeadingCorrection(NamedTuple):
    """Rotation about the world's z that the magnetometer asks for."""

    z: float
    """To magnetic north [rad]."""
    gain: float
    """Part of the rotation that is done."""


ADAPTIVE_STATE = ('bias', 'rest', 'disturbance', 'adaptive')
"""Fields of the state that are unused where the filter neither adapts nor learns."""
FIXED_STATE = ('variance', 'lag', 'age', 'rest')
"""Fields of the state that the adaptive filter does not use."""


def initial_state() -> State:
    """Return the state before the first sample."""
    return State(
        stamp=-1,
        orientation=IDENTITY,
        bias=ZERO,
        variance=(0.0, 0.0),
        lag=(0.0, 0.0),
        age=0.0,
        field_stamp=-1,
        rest=start_rest(ZERO, ZERO, ZERO),
        disturbance=0.0,
        adaptive=no_adaptation(),
    )


@kernel
def update(state: State, params: Params, sample: Sample) -> tuple[State, Estimate]:
    """Return state and estimate after a sample."""
    state, flags = _update(state, params, sample, params.learn_bias, params.adaptive)
    q, covariance = _shown(state, sample.stamp, flags, params.adaptive)
    return state, Estimate(orientation=q, covariance=covariance, flags=flags)


@kernel
def step(
    states: Any, params: Any, stamp: int, w: Vector, f: Vector, m: Vector
) -> tuple[Quaternion, Symmetric, int]:
    """Return the fields of the estimate after those of a sample.

    State and parameters are held (`live_state`); plain tuples pass in a tenth of the time.
    """
    states[0], found = update(states[0], params[0], Sample(stamp, w, f, m))
    return found.orientation, found.covariance, found.flags


@inline
def _shown(state: State, stamp: int, flags: int, adaptive: bool) -> tuple[Quaternion, Symmetric]:
    """Return attitude and covariance at a stamp [ns], without a rate as the last one has them."""
    if not adaptive:
        return _orientation(state), _covariance(state)
    known = state.adaptive
    if not flags & INVALID_GYROSCOPE or stamp <= state.stamp:
        return _orientation(state), known.shown
    interval = 1e-9 * (stamp - state.stamp)
    return held(state.orientation, state.bias, known.shown, known.averages, interval)


@inline
def _update(
    state: State, params: Params, sample: Sample, learns: bool, adaptive: bool
) -> tuple[State, int]:
    """Return state and flags; constants False leave learning and adaptation out of the code."""
    seen, flags = check_sample(sample, state.stamp, state.field_stamp, params.samples)
    if flags & DROPPED:
        return state, flags
    if flags & REINITIALISED:
        return _start(state, params, seen, flags)
    if adaptive:
        return _adapt(state, params, seen, flags)
    predicted = _integrate(state, seen)
    rows = matrix(predicted)
    tilt = _inclination_correction(params, seen, rows)
    turn = _heading_correction(params, seen, rows, tilt.gain)
    corrected = _correct(state.orientation, predicted, tilt, turn)
    rest, bias, rest_flags = _learn_bias(state, params, seen, rows, tilt, turn, learns)
    variance, lag = _propagate_errors(state, params, seen.interval, tilt, turn)
    return State(
        stamp=seen.stamp,
        orientation=corrected,
        bias=bias,
        variance=variance,
        lag=lag,
        age=state.age + seen.interval,
        field_stamp=seen.stamp if seen.has_field else state.field_stamp,
        rest=rest,
        disturbance=state.disturbance,
        adaptive=state.adaptive,
    ), flags | rest_flags


@inline
def _adapt(state: State, params: Params, seen: CheckedSample, flags: int) -> tuple[State, int]:
    """Return state and flags of the adaptive filter after a sample."""
    predicted = integrate(state.orientation, state.bias, state.adaptive.averages.rate, seen)
    adaptive, q, bias, disturbance = adaptive_step(
        state.adaptive, params.averaging, seen, predicted, state.bias, flags
    )
    disturbance = disturbance if disturbance >= 0.0 else state.disturbance
    flags |= averaging_flags(adaptive.averages, params.averaging, disturbance, seen.has_field)
    return State(
        stamp=seen.stamp,
        orientation=q,
        bias=bias,
        variance=state.variance,
        lag=state.lag,
        age=state.age + seen.interval,
        field_stamp=seen.stamp if seen.has_field else state.field_stamp,
        rest=state.rest,
        disturbance=disturbance,
        adaptive=adaptive,
    ), flags


@inline
def _start(state: State, params: Params, seen: CheckedSample, flags: int) -> tuple[State, int]:
    """Set the attitude from one specific force and field; the bias survives all but a jump."""
    f, m = seen.linear_acceleration, seen.magnetic_field
    if not seen.has_field:
        flags |= SIX_AXIS
    if not seen.has_force:
        flags |= NOT_STARTED
    q = attitude_from_vectors(f, m, params.up, params.north) if seen.has_force else IDENTITY
    adaptive = state.adaptive
    if params.adaptive:
        adaptive = start_adaptive(adaptive, params.averaging, seen, flags)
    heading_sigma = params.heading_sigma if seen.has_field else pi
    return State(
        stamp=seen.stamp if seen.has_force else -1,
        orientation=q if seen.has_force else state.orientation,
        bias=ZERO if flags & JUMPED_BACK else state.bias,
        variance=(params.inclination_sigma**2, heading_sigma**2),
        lag=(0.0, 0.0),
        age=0.0,
        field_stamp=seen.stamp if seen.has_force and seen.has_field else -1,
        rest=start_rest(seen.angular_velocity, f, m),
        disturbance=0.0,
        adaptive=adaptive,
    ), flags


@inline
def _integrate(state: State, seen: CheckedSample) -> Quaternion:
    """Return the attitude carried on by the gyroscope."""
    rate = subtract(seen.angular_velocity, state.bias)
    return multiply(state.orientation, from_rotation_vector(scale(seen.interval, rate)))


@inline
def _inclination_correction(
    params: Params, seen: CheckedSample, rows: Matrix
) -> InclinationCorrection:
    """Return the rotation to specific force upward; `rows`: attitude, sensor → world."""
    if not seen.has_force:
        return InclinationCorrection(x=0.0, y=0.0, gain=0.0, sigma=0.0)
    f = seen.linear_acceleration
    length = sqrt(dot(f, f))
    x, y = _inclination_error(transform(rows, scale(1.0 / length, f)), params.up)
    return InclinationCorrection(
        x=x,
        y=y,
        gain=_gain(params.inclination_rate, seen.interval),
        sigma=params.inclination_sigma + abs(length * PER_GRAVITY - 1.0),
    )


@inline
def _heading_correction(
    params: Params, seen: CheckedSample, rows: Matrix, tilt_gain: float
) -> HeadingCorrection:
    """Return the rotation of the horizontal field to magnetic north."""
    m = transform(rows, seen.magnetic_field)
    level = sqrt(m[0] * m[0] + m[1] * m[1])
    if not seen.has_field or level <= 1e-3 * abs(m[2]):
        return HeadingCorrection(z=0.0, gain=0.0)
    gain, interval = tilt_gain, seen.field_interval
    is_as_tilt = interval == seen.interval and params.heading_rate == params.inclination_rate
    if not (seen.has_force and is_as_tilt):
        gain = _gain(params.heading_rate, interval)
    return HeadingCorrection(z=_heading_error(m, level, params.north), gain=gain)


@inline
def _correct(
    before: Quaternion,
    predicted: Quaternion,
    tilt: InclinationCorrection,
    turn: HeadingCorrection,
) -> Quaternion:
    """Return the prediction turned in the world by both corrections, of nearly unit length.

    It is rescaled by the length² of the attitude before, which keeps square root and division out
    of the way of the next sample; the length stays within the square of half a correction of 1.
    """
    square = before[0] ** 2 + before[1] ** 2 + before[2] ** 2 + before[3] ** 2
    factor = 1.5 - 0.5 * square
    half_tilt, half_turn = 0.5 * factor * tilt.gain, 0.5 * factor * turn.gain
    return multiply(
        (half_tilt * tilt.x, half_tilt * tilt.y, half_turn * turn.z, factor), predicted
    )


@inline
def _learn_bias(
    state: State,
    params: Params,
    seen: CheckedSample,
    rows: Matrix,
    tilt: InclinationCorrection,
    turn: HeadingCorrection,
    learns: bool,
) -> tuple[RestState, Vector, int]:
    """Return rest, bias and flags: learned from the mean rate at rest, or from the corrections."""
    if not learns:
        return state.rest, state.bias, 0
    rest = state.rest
    if seen.has_force:
        rest = update_rest(rest, params.rest, seen, state.bias)
    if rest.duration >= params.rest.duration:
        bias, flags = _bias_at_rest(state.bias, rest, params, seen.interval)
        return rest, bias, flags
    has_settled = state.age * params.inclination_rate >= 1.0
    if params.learn_bias and params.bias_rate > 0.0 and has_settled:
        return rest, _bias_in_motion(state.bias, params, rows, tilt, turn), 0
    return rest, state.bias, 0


@inline
def _bias_at_rest(bias: Vector, rest: RestState, params: Params, dt: float) -> tuple[Vector, int]:
    """Let the bias approach the mean rate at rest, unless that is more than a bias can be."""
    mean = rest.angular_velocity
    if not (params.learn_bias and is_bias(rest, params.rest)):
        return bias, AT_REST
    if dot(mean, mean) > params.rest.bias_limit * params.rest.bias_limit:
        return bias, AT_REST | BIAS_LIMITED
    return approach(bias, mean, dt / (params.rest_bias_time + dt)), AT_REST


@inline
def _bias_in_motion(
    bias: Vector,
    params: Params,
    rows: Matrix,
    tilt: InclinationCorrection,
    turn: HeadingCorrection,
) -> Vector:
    """Let the bias take its part of the correction just made (integral action), sensor frame."""
    inclination = params.bias_rate * params.inclination_rate
    heading = params.bias_rate * params.heading_rate
    part = (
        inclination * (tilt.gain * tilt.x),
        inclination * (tilt.gain * tilt.y),
        heading * (turn.gain * turn.z),
    )
    corrected = subtract(bias, to_sensor(rows, part))
    limit = params.rest.bias_limit
    return corrected if dot(corrected, corrected) < limit * limit else bias


@inline
def _propagate_errors(
    state: State,
    params: Params,
    dt: float,
    tilt: InclinationCorrection,
    turn: HeadingCorrection,
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the variances from noise and the errors from a bias, inclination and heading."""
    walk = params.angle_random_walk * params.angle_random_walk * dt
    drift = params.bias_sigma * dt
    variance = (
        _filtered(state.variance[0] + walk, tilt.gain, tilt.sigma),
        _filtered(state.variance[1] + walk, turn.gain, params.heading_sigma),
    )
    lag = (
        (1.0 - tilt.gain) * (state.lag[0] + drift),
        (1.0 - turn.gain) * (state.lag[1] + drift),
    )
    return variance, lag


@inline
def _inclination_error(up: Vector, sign: float) -> tuple[float, float]:
    """Return x, y of the rotation vector that turns `up` to the vertical: its sine, at most 1."""
    x, y = up[1] * sign, -up[0] * sign
    if up[2] * sign < 0.0:  # beyond 90° the sine falls again; the correction must not
        length = sqrt(x * x + y * y)
        return (x / length, y / length) if length > 1e-6 else (1.0, 0.0)
    return x, y


@inline
def _heading_error(m: Vector, level: float, north: tuple[float, float]) -> float:
    """Return the sine of the angle from the horizontal field to `north`; ±1 beyond 90°."""
    sine = (m[0] * north[1] - m[1] * north[0]) / level
    if m[0] * north[0] + m[1] * north[1] < 0.0:
        return -1.0 if sine < 0.0 else 1.0
    return sine


@inline
def _gain(rate: float, dt: float) -> float:
    """Return 1 − exp(−rate · dt)."""
    x = rate * dt
    if x > 0.5:
        return 1.0 - exp(-x)
    square = x * x
    return x / (1.0 + 0.5 * x + square * (1 / 12 - square * (1 / 720 - square * (1 / 30240))))


@inline
def _filtered(variance: float, gain: float, sigma: float) -> float:
    """Return the variance after one step of a low-pass over samples of `sigma`."""
    return (1.0 - gain) * (1.0 - gain) * variance + gain * gain * sigma * sigma


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


@inline
def _covariance(state: State) -> Symmetric:
    """Return xx, xy, xz, yy, yz, zz of the orientation error about the world's axes [rad²]."""
    tilt = state.variance[0] + state.lag[0] * state.lag[0]
    turn = state.variance[1] + state.lag[1] * state.lag[1]
    return tilt, 0.0, 0.0, tilt, 0.0, turn


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
        q, c = _shown(state, samples.stamp[i], flags, adaptive)
        q, c = (q, c) if started else (NAN4, NAN6)
        b = state.bias if started else NAN3
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
