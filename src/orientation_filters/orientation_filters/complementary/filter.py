# SPDX-License-Identifier: Apache-2.0
"""What the complementary filter is told and what it remembers."""

from __future__ import annotations

from math import exp, sqrt
from typing import NamedTuple

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording, IntArray
from numpy.typing import NDArray

from orientation_filters.kernel import inline, kernel
from orientation_filters.magnetic_reference import (
    FieldParams,
    FieldState,
    judge_field,
    no_reference,
)
from orientation_filters.rest_detection import (
    RestParams,
    RestState,
    is_bias,
    start_rest,
    watch_rest,
)
from orientation_filters.result import (
    AT_REST,
    BIAS_LIMITED,
    DISTURBED,
    DROPPED,
    INVALID_ACCELEROMETER,
    JUMPED_BACK,
    NOT_STARTED,
    REINITIALISED,
    SIX_AXIS,
    OrientationResult,
    empty_result,
)
from orientation_filters.rotation.scalars import (
    Matrix,
    Quaternion,
    Vector,
    absent,
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
from orientation_filters.sample_checks import check_sample, check_time, columns, is_field


class Params(NamedTuple):
    """Numbers the kernel needs; `parameters` makes them from named ones with units."""

    up: float
    """World z of the upward direction: +1 ENU, −1 NED."""
    north: tuple[float, float]
    """World x, y of magnetic north (unit vector)."""
    use_magnetometer: bool
    inclination_rate: float
    """2π × cut-off of the accelerometer's correction [rad/s]."""
    heading_rate: float
    """2π × cut-off of the magnetometer's correction [rad/s]."""
    max_gap: int
    """[ns]"""
    magnetometer_timeout: int
    """[ns]"""
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
    start_time: float
    """Time over which the gain falls from 1 to the cut-off's, in 1 / rate."""
    bias_rate: float
    """Integral gain in motion, as a part of rate² [1]."""
    rest_bias_time: float
    """Time constant of bias learning at rest [s]."""
    rest: RestParams
    field: FieldParams


class State(NamedTuple):
    """What one sample leaves for the next."""

    stamp: int
    """Of the last sample used [ns]; −1 before the first."""
    orientation: Quaternion
    """Of nearly unit length; `orientation` gives it exactly."""
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
    field: FieldState


ADAPTIVE_STATE = ('bias', 'rest', 'field')
"""Fields of the state that the filter makes no use of where it neither adapts nor learns."""


def initial_state() -> State:
    """Return the state before the first sample."""
    zero = (0.0, 0.0, 0.0)
    start = (0.0, 0.0, 0.0, 1.0)
    rest = start_rest(zero, zero, zero)
    return State(-1, start, zero, (0.0, 0.0), (0.0, 0.0), 0.0, -1, rest, no_reference())


__all__ = ['ADAPTIVE_STATE', 'Params', 'State', 'initial_state', 'run', 'update']

NAN3 = (np.nan,) * 3
NAN4 = (np.nan,) * 4
NAN6 = (np.nan,) * 6


@kernel
def update(
    state: State, params: Params, stamp: int, w: Vector, f: Vector, m: Vector
) -> tuple[State, int]:
    """Return state and flags after a sample: stamp [ns], rad/s, m/s², T (NaN: no sample)."""
    return _step(state, params, stamp, w, f, m, params.adaptive or params.learn_bias)


@inline
def _step(
    state: State, params: Params, stamp: int, w: Vector, f: Vector, m: Vector, watchful: bool
) -> tuple[State, int]:
    """Do what `update` promises; a constant False leaves what adapts and learns out."""
    flags = check_sample(w, f, m) | check_time(stamp, state.stamp, params.max_gap)
    if flags & DROPPED:
        return state, flags if state.stamp >= 0 else flags | NOT_STARTED
    has_field = params.use_magnetometer and is_field(m)
    if flags & REINITIALISED or (has_field and state.field_stamp < 0):
        return _start(state, params, stamp, w, f, m if has_field else NAN3, flags)
    adaptive = watchful and params.adaptive
    dt = (stamp - state.stamp) * 1e-9
    rate = subtract(w, state.bias)
    before = state.orientation
    square = before[0] ** 2 + before[1] ** 2 + before[2] ** 2 + before[3] ** 2
    q = multiply(before, from_rotation_vector(scale(dt, rate)))
    rows = matrix(q)
    x, y, tilt_gain, tilt_sigma = correct_inclination(state, params, rows, f, dt, flags, adaptive)
    known_gain = (dt if tilt_gain > 0.0 else -1.0, tilt_gain)
    seen = transform(rows, m)
    z, turn_gain, field, field_flags = correct_heading(
        state, params, seen, stamp, rate, has_field, known_gain, adaptive
    )
    flags |= field_flags
    q = turn(q, (x, y, z), tilt_gain, turn_gain, square)
    rest, bias = state.rest, state.bias
    if watchful:
        since = (stamp - state.field_stamp) * 1e-9
        rest = watch_rest(rest, params.rest, w, f, m, has_field, dt, since, bias)
        turned = (tilt_gain * x, tilt_gain * y, turn_gain * z)
        bias, rest_flags = learn(bias, params, rest, rows, turned, state.age, dt)
        flags |= rest_flags
    variance, lag = spread_errors(state, params, dt, (tilt_gain, turn_gain), tilt_sigma)
    field_stamp = stamp if has_field else state.field_stamp
    age = state.age + dt
    return State(stamp, q, bias, variance, lag, age, field_stamp, rest, field), flags


@inline
def _start(
    state: State, params: Params, stamp: int, w: Vector, f: Vector, m: Vector, flags: int
) -> tuple[State, int]:
    """Set the attitude from one specific force and field; the bias survives all but a jump."""
    flags |= REINITIALISED
    bias = (0.0, 0.0, 0.0) if flags & JUMPED_BACK else state.bias
    field = no_reference() if flags & JUMPED_BACK else state.field
    variance = (params.inclination_sigma**2, params.heading_sigma**2)
    field_stamp = stamp
    if absent(m):
        field_stamp = -1
        flags |= SIX_AXIS
        variance = (variance[0], np.pi**2)
    q = state.orientation
    if flags & INVALID_ACCELEROMETER:
        stamp, field_stamp = -1, -1
        flags |= NOT_STARTED
    else:
        q = attitude_from_vectors(f, m, params.up, params.north)
    rest = start_rest(w, f, m)
    return State(stamp, q, bias, variance, (0.0, 0.0), 0.0, field_stamp, rest, field), flags


@kernel
def orientation(state: State) -> Quaternion:
    """Return the attitude, sensor → world, of unit length, w ≥ 0."""
    q = state.orientation
    excess = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0
    if abs(excess) > 1e-4:
        return normalised(q)
    factor = 1.0 + excess * (0.375 * excess - 0.5)  # 1/√(1 + excess) to 3e-13
    if q[3] < 0.0:
        factor = -factor
    return q[0] * factor, q[1] * factor, q[2] * factor, q[3] * factor


@kernel
def covariance(state: State) -> tuple[float, float, float, float, float, float]:
    """Return xx, xy, xz, yy, yz, zz of the orientation error about the world's axes [rad²]."""
    tilt = state.variance[0] + state.lag[0] * state.lag[0]
    turn = state.variance[1] + state.lag[1] * state.lag[1]
    return tilt, 0.0, 0.0, tilt, 0.0, turn


def run(recording: ImuRecording, params: Params) -> OrientationResult:
    """Return attitude, covariance, bias and flags of every row of the recording."""
    result = empty_result(recording.stamp, covariances=2)
    _run(
        initial_state(),
        params,
        *columns(recording),
        result.orientation,
        result.spread,
        result.bias,
        result.flags,
    )
    return result


@kernel
def _run(  # noqa: PLR0913, PLR0917 (one loop over columns, compiled)
    state: State,
    params: Params,
    stamp: IntArray,
    w: FloatArray,
    f: FloatArray,
    m: FloatArray,
    attitude: FloatArray,
    spread: FloatArray,
    bias: FloatArray,
    row_flags: NDArray[np.int32],
) -> None:
    if params.adaptive or params.learn_bias:
        _loop(state, params, stamp, w, f, m, attitude, spread, bias, row_flags, True)
    else:
        _loop(state, params, stamp, w, f, m, attitude, spread, bias, row_flags, False)


@inline
def _loop(  # noqa: PLR0913, PLR0917 (as _run)
    state: State,
    params: Params,
    stamp: IntArray,
    w: FloatArray,
    f: FloatArray,
    m: FloatArray,
    attitude: FloatArray,
    spread: FloatArray,
    bias: FloatArray,
    row_flags: NDArray[np.int32],
    watchful: bool,
) -> None:
    """Go over the rows; compiled once for each constant `watchful`."""
    for i in range(len(stamp)):
        state, flags = _step(state, params, stamp[i], _row(w, i), _row(f, i), _row(m, i), watchful)
        if flags:
            row_flags[i] = flags
        q, c, b = orientation(state), covariance(state), state.bias
        if flags & NOT_STARTED:
            q, c, b = NAN4, NAN6, NAN3
        for k in range(4):
            attitude[i, k] = q[k]
        spread[i, 0] = c[0]
        spread[i, 1] = c[5]
        if watchful or flags:
            for k in range(3):
                bias[i, k] = b[k]


@inline
def _row(column: FloatArray, i: int) -> Vector:
    return column[i, 0], column[i, 1], column[i, 2]


PER_GRAVITY = 1.0 / 9.81


@inline
def correct_inclination(
    state: State,
    params: Params,
    rows: Matrix,
    f: Vector,
    dt: float,
    flags: int,
    adaptive: bool,
) -> tuple[float, float, float, float]:
    """Return x, y of the rotation to specific force upward, gain, the sample's sigma."""
    if flags & INVALID_ACCELEROMETER:
        return 0.0, 0.0, 0.0, 0.0
    gain = _gain(params.inclination_rate, dt, state.age, params, adaptive)
    length = sqrt(dot(f, f))
    if adaptive:  # accelerations average out only where they are not normalised away
        up = transform(rows, scale(params.up * PER_GRAVITY, f))
        x, y = up[1], -up[0]
    else:
        x, y = _inclination_error(transform(rows, scale(1.0 / length, f)), params.up)
    return x, y, gain, params.inclination_sigma + abs(length * PER_GRAVITY - 1.0)


@inline
def correct_heading(
    state: State,
    params: Params,
    seen: Vector,
    stamp: int,
    rate: Vector,
    has_field: bool,
    known_gain: tuple[float, float],
    adaptive: bool,
) -> tuple[float, float, FieldState, int]:
    """Return z of the rotation of the field `seen` to magnetic north, gain, field and flags.

    `known_gain` is a time step [s] and the accelerometer's gain for it.
    """
    since = (stamp - state.field_stamp) * 1e-9
    field = state.field
    if not has_field:
        late = state.field_stamp < 0 or stamp - state.field_stamp > params.magnetometer_timeout
        return 0.0, 0.0, field, SIX_AXIS if late else 0
    level = sqrt(seen[0] * seen[0] + seen[1] * seen[1])
    if adaptive:
        parts = (level, -params.up * seen[2])
        field = judge_field(field, params.field, parts, sqrt(dot(rate, rate)), since)
        if field.accepted_for < params.field.hold:
            return 0.0, 0.0, field, DISTURBED
    if level <= 1e-3 * abs(seen[2]):
        return 0.0, 0.0, field, 0
    gain = known_gain[1]
    if adaptive or since != known_gain[0] or params.heading_rate != params.inclination_rate:
        gain = _gain(params.heading_rate, since, state.age, params, adaptive)
    return _heading_error(seen, level, params.north), gain, field, 0


@inline
def turn(q: Quaternion, error: Vector, tilt: float, spin: float, square: float) -> Quaternion:
    """Return q turned in the world by its part of `error`, rescaled by the length² it had before.

    Rescaling by what is known already keeps square root and division out of the way of the next
    sample; the length stays within the square of half a correction of 1.
    """
    factor = 1.5 - 0.5 * square
    tilt, spin = 0.5 * factor * tilt, 0.5 * factor * spin
    return multiply((tilt * error[0], tilt * error[1], spin * error[2], factor), q)


@inline
def spread_errors(
    state: State, params: Params, dt: float, gain: tuple[float, float], tilt_sigma: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the variances from noise and the errors from a bias, inclination and heading."""
    walk = params.angle_random_walk * params.angle_random_walk * dt
    drift = params.bias_sigma * dt
    variance = (
        _filtered(state.variance[0] + walk, gain[0], tilt_sigma),
        _filtered(state.variance[1] + walk, gain[1], params.heading_sigma),
    )
    lag = ((1.0 - gain[0]) * (state.lag[0] + drift), (1.0 - gain[1]) * (state.lag[1] + drift))
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
def _heading_error(seen: Vector, level: float, north: tuple[float, float]) -> float:
    """Return the sine of the angle from the horizontal field to `north`; ±1 beyond 90°."""
    sine = (seen[0] * north[1] - seen[1] * north[0]) / level
    if seen[0] * north[0] + seen[1] * north[1] < 0.0:
        return -1.0 if sine < 0.0 else 1.0
    return sine


@inline
def _gain(rate: float, dt: float, age: float, params: Params, adaptive: bool) -> float:
    """Return 1 − exp(−rate · dt); the adaptive filter starts as a mean and becomes a low-pass."""
    if adaptive:
        rate = max(rate, params.start_time / (age + dt))
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
def learn(
    bias: Vector,
    params: Params,
    rest: RestState,
    rows: Matrix,
    turned: Vector,
    age: float,
    dt: float,
) -> tuple[Vector, int]:
    """Return the bias after a sample that turned the attitude by `turned` [rad], and flags."""
    if rest.duration >= params.rest.duration:
        return _learn_at_rest(bias, rest, params, dt)
    if params.learn_bias and params.bias_rate > 0.0 and age * params.inclination_rate >= 1.0:
        return _learn_in_motion(bias, params, rows, turned), 0
    return bias, 0


@inline
def _learn_at_rest(bias: Vector, rest: RestState, params: Params, dt: float) -> tuple[Vector, int]:
    """Let the bias approach the mean rate at rest, unless that is more than a bias can be."""
    mean = rest.angular_velocity
    if not (params.learn_bias and is_bias(rest, params.rest)):
        return bias, AT_REST
    if dot(mean, mean) > params.rest.bias_limit * params.rest.bias_limit:
        return bias, AT_REST | BIAS_LIMITED
    return approach(bias, mean, dt / (params.rest_bias_time + dt)), AT_REST


@inline
def _learn_in_motion(bias: Vector, params: Params, rows: Matrix, turned: Vector) -> Vector:
    """Let the bias take its part of the correction just made (integral action), sensor frame."""
    tilt = params.bias_rate * params.inclination_rate
    spin = params.bias_rate * params.heading_rate
    part = (tilt * turned[0], tilt * turned[1], spin * turned[2])
    corrected = subtract(bias, to_sensor(rows, part))
    limit = params.rest.bias_limit
    return corrected if dot(corrected, corrected) < limit * limit else bias
