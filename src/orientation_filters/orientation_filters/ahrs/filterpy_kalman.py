# SPDX-License-Identifier: Apache-2.0
"""The AHRS's Kalman step on filterpy.kalman.KalmanFilter: matrices as printed, an own check.

Same module interface as `ahrs_kalman`, whose intake it shares; the 12×12 covariance, the 6×12
measurement matrix, the innovation and its inverse are filterpy's and numpy's business.
"""

from __future__ import annotations

from functools import cache
from math import atan2, cos, pi, sin
from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter
from imu_recording.recording import FloatArray, ImuRecording

from orientation_filters.ahrs import filter as ahrs_kalman
from orientation_filters.ahrs.adaptive import Observation, weigh
from orientation_filters.ahrs.adaptive_step import apply_errors, flags_after, gather_sample
from orientation_filters.ahrs.joint_covariance import Errors, JointCovariance
from orientation_filters.ahrs.measurement_update import Symmetric, Variances
from orientation_filters.ahrs.state import GRAVITY, MICROTESLA, Params, State, initial_state
from orientation_filters.result import (
    INVALID_ACCELEROMETER,
    JAMMED,
    NOT_STARTED,
    OrientationResult,
    empty_result,
)
from orientation_filters.rotation.arrays import (
    conjugate,
    from_rotation_vector,
    multiply,
    normalised,
    rotate,
)
from orientation_filters.rotation.scalars import Vector


def update(
    state: State, params: Params, stamp: int, w: Vector, f: Vector, m: Vector
) -> tuple[State, int]:
    """Return state and flags after a sample, as `ahrs_kalman.update`."""
    flags, has_field = ahrs_kalman.admit(state, params, stamp, w, f, m)
    if flags & ahrs_kalman.NOT_A_STEP:
        return ahrs_kalman.update(state, params, stamp, w, f, m)
    interval = (stamp - state.stamp) * 1e-9
    q = multiply(
        np.array(state.orientation),
        from_rotation_vector((np.array(w) - state.bias) * interval),
    )
    if params.adaptive.enabled:
        start = tuple(q.tolist())
        state, due, flags = gather_sample(state, params, stamp, start, w, f, m, has_field, flags)
        if due:
            seen = weigh(state.adaptive, params.adaptive, state.bias, params.up, params.north)
            state = apply_errors(state, params, seen, adaptive_errors(seen, params.up))
        return state, flags_after(state, params, has_field, flags)
    has_gravity = not flags & INVALID_ACCELEROMETER
    noise = params.noise
    down = np.array([0.0, 0.0, -params.up])
    field = _field_vector(params, atan2(state.dip[1], state.dip[0]))
    gravity = rotate(conjugate(q), GRAVITY * down)
    expected = rotate(conjugate(q), field)
    acceleration = noise.linear_acceleration_decay * np.array(state.linear_acceleration)
    innovation = np.concatenate(
        [-np.array(f) + acceleration - gravity, MICROTESLA * np.array(m) - expected]
    )
    x, p = _kalman_update(
        _prior(state, params, interval),
        _measurement_matrix(gravity, expected, interval),
        _measurement_noise(params, interval),
        innovation,
        [has_gravity] * 3 + [has_field] * 3,
        2.0 * params.field_strength,
    )
    jammed = float(np.sum(x[9:] ** 2)) > 4.0 * params.field_strength**2
    q = normalised(multiply(q, from_rotation_vector(-x[:3])))
    dip = state.dip
    if jammed:
        flags |= JAMMED
    elif has_field:
        dip = _dip(params, field - rotate(q, x[9:]), state.dip)
    variances = [(float(v[0]), float(v[1]), float(v[2])) for v in np.diag(p).reshape(4, 3)]
    if not params.adaptive.learn_bias:
        variances[1] = state.variances.bias
    return State(
        stamp,
        tuple(q.tolist()),
        tuple((np.array(state.bias) - x[3:6]).tolist()),
        tuple((acceleration - x[6:9]).tolist()),
        tuple(x[9:].tolist()) if has_field else state.magnetic_disturbance,
        dip,
        Variances(*variances),
        state.updates + 1,
        stamp if has_field else state.field_stamp,
        state.adaptive,
    ), flags


def adaptive_errors(seen: Observation, up: float) -> Errors:
    """Return what `ahrs_adaptive.take_in` returns, by one update of all twelve states.

    Linear acceleration [m/s²] and the field's turn [rad] are states whose variance is all the
    noise there is.
    """
    prior = np.zeros((12, 12))
    prior[:6, :6] = _matrix_of(seen.prior)
    prior[6:, 6:] = np.diag(
        [max(seen.force_variance, 0.0)] * 3 + [max(seen.east_variance, 0.0)] * 3
    )
    h, noise, identity = np.zeros((6, 12)), np.zeros(6), np.eye(3)
    pull = up * GRAVITY
    h[0, [1, 6]], h[1, [0, 7]], h[2, [2, 11]] = (pull, 1.0), (-pull, 1.0), (-1.0, 1.0)
    h[3:, 3:6] = identity
    noise[3:] = seen.rest_variance
    z = np.array([*seen.acceleration[:2], seen.east, *seen.rest_error])
    present = (
        [seen.force_variance > 0] * 2 + [seen.east_variance > 0] + [seen.rest_variance > 0] * 3
    )
    x, p = _kalman_update(prior, h, np.diag(noise), z, present, np.inf)
    errors = x[:6].tolist()
    return Errors(tuple(errors[:3]), tuple(errors[3:]), _joint_of(p[:6, :6]))


@cache
def _kalman_filter(measurements: int) -> Any:
    """Return filterpy's filter for that many rows; state and covariance are set at every use."""
    return KalmanFilter(dim_x=12, dim_z=measurements)


def _matrix_of(p: JointCovariance) -> FloatArray:
    """Return the 6×6 covariance of its blocks."""
    places = [[0, 1, 2], [1, 3, 4], [2, 4, 5]]
    t, b, c = np.array(p.orientation)[places], np.array(p.bias)[places], np.array(p.cross)
    return np.block([[t, c], [c.T, b]])


def _joint_of(p: FloatArray) -> JointCovariance:
    """Return the blocks of a 6×6 covariance."""
    rows, columns = np.triu_indices(3)
    t, b = p[:3, :3][rows, columns].tolist(), p[3:, 3:][rows, columns].tolist()
    c0, c1, c2 = (tuple(row) for row in p[:3, 3:].tolist())
    return JointCovariance(tuple(t), (c0, c1, c2), tuple(b))


def _kalman_update(
    prior: FloatArray,
    h: FloatArray,
    noise: FloatArray,
    innovation: FloatArray,
    present: list[bool],
    jam_limit: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the error state and its covariance; sensors that are absent have no rows."""
    rows = np.flatnonzero(present)
    if not len(rows):
        return np.zeros(12), prior
    kalman = _kalman_filter(len(rows))
    kalman.x = np.zeros((12, 1))
    kalman.P = prior
    kalman.update(innovation[rows, None], R=noise[np.ix_(rows, rows)], H=h[rows])
    x = kalman.x[:, 0].copy()
    if np.linalg.norm(x[9:]) > jam_limit:
        x[:9] = kalman.K[:9] @ np.where(rows < 3, innovation[rows], 0.0)
    return x, kalman.P


def _prior(state: State, params: Params, interval: float) -> FloatArray:
    """Return P⁻ (12, 12) of the note's process noise Q; everything it does not name is zero."""
    t, b, a, d = (np.array(v) for v in state.variances)
    noise, learns = params.noise, params.adaptive.learn_bias
    b *= learns
    if state.updates == 0:
        return np.diag(np.concatenate([t, b, a, d]))
    beta, eta = noise.gyroscope_drift, noise.gyroscope
    prior = np.diag(
        np.concatenate(
            [
                t + interval**2 * (b + beta + eta),
                (b + beta) * learns,
                noise.linear_acceleration_decay**2 * a + noise.linear_acceleration,
                noise.magnetic_disturbance_decay**2 * d + noise.magnetic_disturbance,
            ]
        )
    )
    coupling = np.diag(-interval * (b + beta) * learns)
    prior[:3, 3:6] = coupling
    prior[3:6, :3] = coupling
    return prior


def _measurement_matrix(gravity: FloatArray, field: FloatArray, interval: float) -> FloatArray:
    """Return H (6, 12) for gravity [m/s²] and field [µT] in the sensor frame."""
    g, m, one, none = _skew(gravity), _skew(field), np.eye(3), np.zeros((3, 3))
    return np.block([[-g, interval * g, one, none], [-m, interval * m, none, -one]])


def _measurement_noise(params: Params, interval: float) -> FloatArray:
    """Return R (6, 6)."""
    noise = params.noise
    gyroscope = interval**2 * (noise.gyroscope_drift + noise.gyroscope)
    force = noise.accelerometer + noise.linear_acceleration + gyroscope
    field = noise.magnetometer + noise.magnetic_disturbance + gyroscope
    return np.diag([force] * 3 + [field] * 3)


def _skew(v: FloatArray) -> FloatArray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _field_vector(params: Params, inclination: float) -> FloatArray:
    """Return the expected field in the world [µT]."""
    level = params.field_strength * cos(inclination)
    sunk = params.field_strength * sin(inclination)
    return np.array([level * params.north[0], level * params.north[1], -params.up * sunk])


def _dip(params: Params, field: FloatArray, before: tuple[float, float]) -> tuple[float, float]:
    """Return cosine and sine of the field's inclination, −90° … 90°."""
    level = float(field[:2] @ np.array(params.north))
    inclination = atan2(-params.up * float(field[2]), level)
    inclination = min(max(inclination, -0.5 * pi), 0.5 * pi)
    return (cos(inclination), sin(inclination)) if np.any(field) else before


def orientation(state: State) -> tuple[float, float, float, float]:
    """Return the attitude, sensor → world, w ≥ 0."""
    return state.orientation


def covariance(state: State) -> Symmetric:
    """Return xx, xy, xz, yy, yz, zz of the orientation error about the world's axes [rad²]."""
    packed: Symmetric = ahrs_kalman.covariance(state)
    return packed


def run(recording: ImuRecording, params: Params, *, details: bool = False) -> OrientationResult:
    """Return attitude, covariance, bias and flags of every row, as `ahrs_kalman.run`."""
    result = empty_result(recording.stamp, details=details)
    state = initial_state()
    columns = (recording.angular_velocity, recording.linear_acceleration, recording.magnetic_field)
    for i, (stamp, *vectors) in enumerate(
        zip(recording.stamp.tolist(), *(c.tolist() for c in columns), strict=True)
    ):
        w, f, m = (tuple(v) for v in vectors)
        state, flags = update(state, params, stamp, w, f, m)
        started = not flags & NOT_STARTED
        result.flags[i] = flags
        result.orientation[i] = state.orientation if started else np.nan
        result.spread[i] = ahrs_kalman.covariance(state) if started else np.nan
        result.bias[i] = state.bias if started else np.nan
        if details and started:
            _write_details(result, i, state)
    return result


def _write_details(result: OrientationResult, i: int, state: State) -> None:
    for column, value in (
        (result.linear_acceleration, state.linear_acceleration),
        (result.magnetic_disturbance, np.array(state.magnetic_disturbance) / MICROTESLA),
        (result.inclination, atan2(state.dip[1], state.dip[0])),
    ):
        if column is not None:
            column[i] = value
