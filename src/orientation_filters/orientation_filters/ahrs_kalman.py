# SPDX-License-Identifier: Apache-2.0
"""AHRS: 12-state indirect Kalman filter for accelerometer, gyroscope and magnetometer.

Equations: NXP Semiconductors, Sensor Fusion Kalman filters technical note (CC BY 4.0), for which
MathWorks' ahrsfilter documents parameters and defaults; ENU and NED. Magnetic quantities are in
µT inside, as the documented noises are.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording, IntArray
from numpy.typing import NDArray

from orientation_filters.ahrs_correction import (
    INITIAL_VARIANCES,
    Noise,
    Symmetric,
    Variances,
    correct,
    predict_variances,
)
from orientation_filters.flags import (
    DROPPED,
    INVALID_ACCELEROMETER,
    INVALID_MAGNETOMETER,
    JAMMED,
    JUMPED_BACK,
    NOT_STARTED,
    REINITIALISED,
    SIX_AXIS,
)
from orientation_filters.intake import check_sample, check_time
from orientation_filters.kernel import kernel
from orientation_filters.quaternion import (
    Matrix,
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
from orientation_filters.result import OrientationResult, empty_result

GRAVITY = 9.81
MICROTESLA = 1e6
NAN3 = (np.nan,) * 3
NAN4 = (np.nan,) * 4
NAN6 = (np.nan,) * 6
ZERO = (0.0, 0.0, 0.0)
NOT_A_STEP = DROPPED | REINITIALISED
"""Flags of samples that set the attitude anew or leave it as it is."""


class Params(NamedTuple):
    """Numbers the kernel needs; `presets` makes them from named parameters with units."""

    up: float
    """World z of the upward direction: +1 ENU, −1 NED."""
    north: tuple[float, float]
    """World x, y of magnetic north (unit vector)."""
    use_magnetometer: bool
    field_strength: float
    """Expected [µT]."""
    max_gap: int
    """[ns]"""
    magnetometer_timeout: int
    """[ns]"""
    noise: Noise


class State(NamedTuple):
    """What one sample leaves for the next."""

    stamp: int
    """Of the last sample used [ns]; −1 before the first."""
    orientation: Quaternion
    bias: Vector
    """Of the gyroscope [rad/s], sensor frame."""
    linear_acceleration: Vector
    """Without gravity [m/s²], sensor frame."""
    magnetic_disturbance: Vector
    """Of the last update [µT], sensor frame."""
    dip: tuple[float, float]
    """Cosine and sine of the field's inclination, downward positive."""
    variances: Variances
    """Prior of the first update while `updates` is 0, else posterior of the last."""
    updates: int
    """Since the attitude was set."""
    field_stamp: int
    """Of the last magnetometer sample [ns]; −1 before the first."""


ADAPTIVE_STATE: tuple[str, ...] = ()
"""Fields of the state that only the adaptive filter makes use of."""


def initial_state() -> State:
    """Return the state before the first sample."""
    q = (0.0, 0.0, 0.0, 1.0)
    return State(-1, q, ZERO, ZERO, ZERO, (1.0, 0.0), INITIAL_VARIANCES, 0, -1)


@kernel
def update(
    state: State, params: Params, stamp: int, w: Vector, f: Vector, m: Vector
) -> tuple[State, int]:
    """Return state and flags after a sample: stamp [ns], rad/s, m/s², T (NaN: no sample)."""
    flags, has_field = admit(state, params, stamp, w, f, m)
    if flags & DROPPED:
        return state, flags
    if flags & REINITIALISED:
        return _start(state, params, stamp, f, m if has_field else NAN3, flags)
    dt = (stamp - state.stamp) * 1e-9
    rate = subtract(w, state.bias)
    q = multiply(state.orientation, from_rotation_vector(scale(dt, rate)))
    field_stamp = stamp if has_field else state.field_stamp
    return _kalman_step(state, params, stamp, q, f, m, dt, field_stamp, has_field, flags)


@kernel
def admit(
    state: State, params: Params, stamp: int, w: Vector, f: Vector, m: Vector
) -> tuple[int, bool]:
    """Return flags of the sample (DROPPED, REINITIALISED …) and whether it has a field."""
    flags = check_sample(w, f, m) | check_time(stamp, state.stamp, params.max_gap)
    if flags & DROPPED:
        return flags if state.stamp >= 0 else flags | NOT_STARTED, False
    has_field = params.use_magnetometer and not absent(m) and not flags & INVALID_MAGNETOMETER
    if has_field and state.field_stamp < 0:
        flags |= REINITIALISED
    elif not has_field and (
        state.field_stamp < 0 or stamp - state.field_stamp > params.magnetometer_timeout
    ):
        flags |= SIX_AXIS
    return flags, has_field


@kernel
def _start(
    state: State, params: Params, stamp: int, f: Vector, m: Vector, flags: int
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
    variances = INITIAL_VARIANCES
    return State(stamp, q, bias, ZERO, ZERO, (1.0, 0.0), variances, 0, field_stamp), flags


@kernel
def _kalman_step(  # noqa: PLR0913, PLR0917 (what update has prepared)
    state: State,
    params: Params,
    stamp: int,
    q: Quaternion,
    f: Vector,
    m: Vector,
    dt: float,
    field_stamp: int,
    has_field: bool,
    flags: int,
) -> tuple[State, int]:
    """Compare what the sensors say with what the attitude predicts, and take the error away."""
    noise, strength = params.noise, params.field_strength
    prior, coupling = state.variances, ZERO
    if state.updates > 0:
        prior, coupling = predict_variances(state.variances, noise, dt)
    rows = matrix(q)
    down = scale(-params.up, rows[2])
    gravity = scale(GRAVITY, down)
    expected = _expected_field(rows, down, params, state.dip)
    acceleration = scale(noise.linear_acceleration_decay, state.linear_acceleration)
    has_gravity = not flags & INVALID_ACCELEROMETER
    z_gravity, z_field = ZERO, ZERO
    if has_gravity:
        z_gravity = subtract(subtract(acceleration, f), gravity)
    if has_field:
        z_field = subtract(scale(MICROTESLA, m), expected)
    c = correct(
        prior,
        coupling,
        noise,
        dt,
        gravity,
        z_gravity,
        has_gravity,
        expected,
        z_field,
        has_field,
        2.0 * strength,
    )
    q = normalised(multiply(q, from_rotation_vector(scale(-1.0, c.orientation))))
    dip = state.dip
    if c.jammed:
        flags |= JAMMED
    elif has_field:
        dip = _corrected_dip(q, params, dip, c.disturbance)
    state = State(
        stamp,
        q,
        subtract(state.bias, c.bias),
        subtract(acceleration, c.acceleration),
        c.disturbance if has_field else state.magnetic_disturbance,
        dip,
        c.variances,
        state.updates + 1,
        field_stamp,
    )
    return state, flags


@kernel
def _expected_field(
    rows: Matrix, down: Vector, params: Params, dip: tuple[float, float]
) -> Vector:
    """Return the field of the expected strength and dip [µT], sensor frame."""
    level = params.field_strength * dip[0]
    east, north = level * params.north[0], level * params.north[1]
    sunk = params.field_strength * dip[1]
    return (
        east * rows[0][0] + north * rows[1][0] + sunk * down[0],
        east * rows[0][1] + north * rows[1][1] + sunk * down[1],
        east * rows[0][2] + north * rows[1][2] + sunk * down[2],
    )


@kernel
def _corrected_dip(
    q: Quaternion, params: Params, dip: tuple[float, float], disturbance: Vector
) -> tuple[float, float]:
    """Return the dip of the expected field less the disturbance, −90° … 90°."""
    d = transform(matrix(q), disturbance)
    level = params.field_strength * dip[0] - params.north[0] * d[0] - params.north[1] * d[1]
    sunk = params.field_strength * dip[1] + params.up * d[2]
    level = max(level, 0.0)
    length = sqrt(level * level + sunk * sunk)
    if length < 1e-9:
        return dip
    return level / length, sunk / length


@kernel
def covariance(state: State) -> Symmetric:
    """Return xx, xy, xz, yy, yz, zz of the orientation error about the world's axes [rad²]."""
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
        recording.stamp,
        np.ascontiguousarray(recording.angular_velocity),
        np.ascontiguousarray(recording.linear_acceleration),
        np.ascontiguousarray(recording.magnetic_field),
        result.orientation,
        result.packed_covariance,
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
    orientation: FloatArray,
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
        row_flags[i] = flags
        q, c, b = state.orientation, covariance(state), state.bias
        if flags & NOT_STARTED:
            q, c, b = NAN4, NAN6, NAN3
        for k in range(4):
            orientation[i, k] = q[k]
        for k in range(6):
            packed[i, k] = c[k]
        for k in range(3):
            bias[i, k] = b[k]
        if len(inclination):
            for k in range(3):
                acceleration[i, k] = state.linear_acceleration[k]
                disturbance[i, k] = state.magnetic_disturbance[k] / MICROTESLA
            inclination[i] = np.arctan2(state.dip[1], state.dip[0])
