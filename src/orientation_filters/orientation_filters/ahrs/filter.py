# SPDX-License-Identifier: Apache-2.0
"""AHRS: 12-state indirect Kalman filter for accelerometer, gyroscope and magnetometer.

Equations: NXP Semiconductors, Sensor Fusion Kalman filters technical note (CC BY 4.0), for which
MathWorks' ahrsfilter documents parameters and defaults; ENU and NED. Magnetic quantities are in
µT inside, as the documented noises are.
"""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording, IntArray
from numpy.typing import NDArray

from orientation_filters.ahrs.adaptive import start_adaptive, take_in, weigh
from orientation_filters.ahrs.adaptive_step import apply_errors, flags_after, gather_sample
from orientation_filters.ahrs.kalman_step import paper_step
from orientation_filters.ahrs.measurement_update import INITIAL_VARIANCES, Symmetric
from orientation_filters.ahrs.state import (
    ADAPTIVE_STATE,
    MICROTESLA,
    ZERO,
    Params,
    State,
    initial_state,
)
from orientation_filters.kernel import inline, kernel
from orientation_filters.magnetic_reference import no_reference
from orientation_filters.result import (
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
    Quaternion,
    Vector,
    absent,
    attitude_from_vectors,
    from_rotation_vector,
    matrix,
    multiply,
    scale,
    subtract,
)
from orientation_filters.sample_checks import check_sample, check_time, columns, is_field

__all__ = ['ADAPTIVE_STATE', 'Params', 'State', 'initial_state', 'run', 'update']

NAN3 = (np.nan,) * 3
NAN4 = (np.nan,) * 4
NAN6 = (np.nan,) * 6
NOT_A_STEP = DROPPED | REINITIALISED
"""Flags of samples that set the attitude anew or leave it as it is."""


@kernel
def update(
    state: State, params: Params, stamp: int, w: Vector, f: Vector, m: Vector
) -> tuple[State, int]:
    """Return state and flags after a sample: stamp [ns], rad/s, m/s², T (NaN: no sample)."""
    flags, has_field = admit(state, params, stamp, w, f, m)
    if flags & DROPPED:
        return state, flags
    if flags & REINITIALISED:
        return _start(state, params, stamp, w, f, m if has_field else NAN3, flags)
    dt = (stamp - state.stamp) * 1e-9
    rate = subtract(w, state.bias)
    q = multiply(state.orientation, from_rotation_vector(scale(dt, rate)))
    if params.adaptive.enabled:
        state, due, flags = gather_sample(state, params, stamp, q, w, f, m, has_field, flags)
        if due:
            seen = weigh(state.adaptive, params.adaptive, state.bias, params.up, params.north)
            state = apply_errors(state, params, seen, take_in(seen, params.up))
        return state, flags_after(state, params, has_field, flags)
    return paper_step(state, params, stamp, q, f, m, dt, has_field, flags)


@inline
def admit(
    state: State, params: Params, stamp: int, w: Vector, f: Vector, m: Vector
) -> tuple[int, bool]:
    """Return flags of the sample (DROPPED, REINITIALISED …) and whether it has a field."""
    flags = check_sample(w, f, m) | check_time(stamp, state.stamp, params.max_gap)
    if flags & DROPPED:
        return flags if state.stamp >= 0 else flags | NOT_STARTED, False
    has_field = params.use_magnetometer and is_field(m)
    if has_field and state.field_stamp < 0:
        flags |= REINITIALISED
    elif not has_field and (
        state.field_stamp < 0 or stamp - state.field_stamp > params.magnetometer_timeout
    ):
        flags |= SIX_AXIS
    return flags, has_field


@inline
def _start(
    state: State, params: Params, stamp: int, w: Vector, f: Vector, m: Vector, flags: int
) -> tuple[State, int]:
    """Set the attitude from one specific force and field; the bias survives all but a jump."""
    bias = ZERO if flags & JUMPED_BACK else state.bias
    field_stamp = stamp
    if absent(m):
        field_stamp = -1
    q = state.orientation
    if flags & INVALID_ACCELEROMETER:
        stamp, field_stamp = -1, -1
        flags |= NOT_STARTED
    else:
        q = attitude_from_vectors(f, m, params.up, params.north)
    adaptive = state.adaptive
    if params.adaptive.enabled:
        reference = no_reference() if flags & JUMPED_BACK else adaptive.reference
        adaptive = start_adaptive(params.adaptive, w, f, m, reference)
    variances, dip = INITIAL_VARIANCES, (1.0, 0.0)
    return State(stamp, q, bias, ZERO, ZERO, dip, variances, 0, field_stamp, adaptive), flags


@kernel
def orientation(state: State) -> Quaternion:
    """Return the attitude, sensor → world, w ≥ 0."""
    return state.orientation


@kernel
def covariance(state: State) -> Symmetric:
    """Return xx, xy, xz, yy, yz, zz of the orientation error about the world's axes [rad²]."""
    if state.adaptive.covariance.orientation[0] > 0.0:
        return state.adaptive.covariance.orientation
    v = state.variances.orientation
    x, y, z = matrix(state.orientation)
    return (
        x[0] * x[0] * v[0] + x[1] * x[1] * v[1] + x[2] * x[2] * v[2],
        x[0] * y[0] * v[0] + x[1] * y[1] * v[1] + x[2] * y[2] * v[2],
        x[0] * z[0] * v[0] + x[1] * z[1] * v[1] + x[2] * z[2] * v[2],
        y[0] * y[0] * v[0] + y[1] * y[1] * v[1] + y[2] * y[2] * v[2],
        y[0] * z[0] * v[0] + y[1] * z[1] * v[1] + y[2] * z[2] * v[2],
        z[0] * z[0] * v[0] + z[1] * z[1] * v[1] + z[2] * z[2] * v[2],
    )


def run(recording: ImuRecording, params: Params, *, details: bool = False) -> OrientationResult:
    """Return attitude, covariance, bias and flags of every row; `details`: more states."""
    result = empty_result(recording.stamp, details=details)
    none = np.empty((0, 3))
    _run(
        initial_state(),
        params,
        *columns(recording),
        result.orientation,
        result.spread,
        result.bias,
        result.flags,
        none if result.linear_acceleration is None else result.linear_acceleration,
        none if result.magnetic_disturbance is None else result.magnetic_disturbance,
        np.empty(0) if result.inclination is None else result.inclination,
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
    packed: FloatArray,
    bias: FloatArray,
    row_flags: NDArray[np.int32],
    acceleration: FloatArray,
    disturbance: FloatArray,
    inclination: FloatArray,
) -> None:
    for i in range(len(stamp)):
        state, flags = update(
            state,
            params,
            stamp[i],
            (w[i, 0], w[i, 1], w[i, 2]),
            (f[i, 0], f[i, 1], f[i, 2]),
            (m[i, 0], m[i, 1], m[i, 2]),
        )
        if flags:
            row_flags[i] = flags
        q, c, b = state.orientation, covariance(state), state.bias
        if flags & NOT_STARTED:
            q, c, b = NAN4, NAN6, NAN3
        for k in range(4):
            attitude[i, k] = q[k]
        for k in range(6):
            packed[i, k] = c[k]
        for k in range(3):
            bias[i, k] = b[k]
        if len(inclination):
            for k in range(3):
                acceleration[i, k] = state.linear_acceleration[k]
                disturbance[i, k] = state.magnetic_disturbance[k] / MICROTESLA
            inclination[i] = np.arctan2(state.dip[1], state.dip[0])
