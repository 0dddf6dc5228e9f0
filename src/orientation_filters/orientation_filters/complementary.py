# SPDX-License-Identifier: Apache-2.0
"""Complementary filter: gyroscope above the cut-off, accelerometer and magnetometer below.

The gyroscope's attitude is turned, by the gain g = 1 − exp(−2π f_c Δt) of a first-order low-pass,
towards the attitude at which specific force points up, then about the vertical towards magnetic
north (quaternion form after Valenti, Dryanovski, Xiao, Sensors 15, 2015). `adaptive` adds what
motion and disturbance ask for: a faster start and rejection of a magnetic field unlike the
reference; `learn_bias` rest detection and bias learning.
"""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording, IntArray
from numpy.typing import NDArray

from orientation_filters.complementary_bias import learn
from orientation_filters.complementary_correction import (
    correct_heading,
    correct_inclination,
    spread_errors,
    turn,
)
from orientation_filters.complementary_state import ADAPTIVE_STATE, Params, State, initial_state
from orientation_filters.flags import (
    DROPPED,
    INVALID_ACCELEROMETER,
    JUMPED_BACK,
    NOT_STARTED,
    REINITIALISED,
    SIX_AXIS,
)
from orientation_filters.intake import check_sample, check_time, columns, is_field
from orientation_filters.kernel import inline, kernel
from orientation_filters.magnetic_reference import no_reference
from orientation_filters.quaternion import (
    Quaternion,
    Vector,
    absent,
    attitude_from_vectors,
    from_rotation_vector,
    matrix,
    multiply,
    normalised,
    scale,
    subtract,
    transform,
)
from orientation_filters.rest import start_rest, watch_rest
from orientation_filters.result import OrientationResult, empty_result

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
