# SPDX-License-Identifier: Apache-2.0
"""The AHRS in matrices as printed, on numpy and filterpy.kalman: the reference of the kernels.

Same module interface as `filter`, whose sample checks, start and means it shares; the 12×12
covariance, the 6×12 measurement matrix, the innovation and its inverse are numpy's and filterpy's.
"""

from __future__ import annotations

from functools import cache
from math import atan2, cos, pi, sin
from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter
from imu_recording.recording import FloatArray, ImuRecording

from orientation_filters.ahrs import filter as native
from orientation_filters.ahrs.adaptive import (
    adaptive_flags,
    add_sample,
    measurements,
    remove_errors,
)
from orientation_filters.ahrs.covariance import Errors, JointCovariance
from orientation_filters.ahrs.state import (
    MICROTESLA_PER_TESLA,
    Params,
    State,
    Variances,
    initial_state,
)
from orientation_filters.result import (
    DROPPED,
    JAMMED,
    NOT_STARTED,
    REINITIALISED,
    Estimate,
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
from orientation_filters.rotation.scalars import matrix
from orientation_filters.sample_checks import GRAVITY, CheckedSample, Sample, check_sample
from orientation_filters.slow_attitude import follow
from orientation_filters.step_averages.accumulation import integrate, is_step_due
from orientation_filters.step_averages.means import Means

__all__ = ['Params', 'State', 'initial_state', 'run', 'update']


def update(state: State, params: Params, sample: Sample) -> tuple[State, Estimate]:
    """Return state and estimate after a sample, as `filter.update`."""
    state, flags = _update(state, params, sample)
    return state, native.estimate(state, params, sample.stamp, flags)


def _update(state: State, params: Params, sample: Sample) -> tuple[State, int]:
    """Return state and flags after a sample."""
    seen, flags = check_sample(sample, state.stamp, state.field_stamp, params.samples)
    if flags & DROPPED:
        return state, flags
    if flags & REINITIALISED:
        return native.start(state, params, seen, flags)
    if params.adaptive:
        carried = integrate(state.orientation, state.bias, state.adaptive.averages, seen)
        state = add_sample(state, params, seen, carried)
        if is_step_due(state.adaptive.averages, params.averaging):
            prior, means = measurements(state, params, flags)
            errors = adaptive_errors(prior, means, params.up)
            state = remove_errors(state, params, means, errors)
        return state, flags | adaptive_flags(state, params, seen)
    angle = (np.array(seen.angular_velocity) - state.bias) * seen.interval
    predicted = multiply(np.array(state.orientation), from_rotation_vector(angle))
    return _kalman_step(state, params, seen, predicted, flags)


def _kalman_step(
    state: State, params: Params, seen: CheckedSample, predicted: FloatArray, flags: int
) -> tuple[State, int]:
    """Return state and flags after the technical note's step."""
    noise, interval = params.noise, seen.interval
    down = np.array([0.0, 0.0, -params.up])
    field = _field_vector(params, atan2(state.dip[1], state.dip[0]))
    gravity = rotate(conjugate(predicted), GRAVITY * down)
    expected = rotate(conjugate(predicted), field)
    acceleration = noise.linear_acceleration_decay * np.array(state.linear_acceleration)
    innovation = np.concatenate(
        [
            -np.array(seen.linear_acceleration) + acceleration - gravity,
            MICROTESLA_PER_TESLA * np.array(seen.magnetic_field) - expected,
        ]
    )
    x, p = _kalman_update(
        _prior(state, params, interval),
        _measurement_matrix(gravity, expected, interval),
        _measurement_noise(params, interval),
        innovation,
        [seen.has_force] * 3 + [seen.has_field] * 3,
        2.0 * params.field_strength,
    )
    q = normalised(multiply(predicted, from_rotation_vector(-x[:3])))
    turned = rotate(predicted, -interval * np.array(state.bias) - x[:3])
    dip = state.dip
    if float(np.sum(x[9:] ** 2)) > 4.0 * params.field_strength**2:
        flags |= JAMMED
    elif seen.has_field:
        dip = _dip(params, field - rotate(q, x[9:]), state.dip)
    t, b, a, d = ((v[0], v[1], v[2]) for v in np.diag(p).reshape(4, 3).tolist())
    if not params.learn_bias:
        b = state.variances.bias
    return State(
        stamp=seen.stamp,
        orientation=tuple(q.tolist()),
        bias=tuple((np.array(state.bias) - x[3:6]).tolist()),
        linear_acceleration=tuple((acceleration - x[6:9]).tolist()),
        magnetic_disturbance=tuple(x[9:].tolist())
        if seen.has_field
        else state.magnetic_disturbance,
        dip=dip,
        variances=Variances(orientation=t, bias=b, acceleration=a, disturbance=d),
        slow=follow(
            state.slow,
            seen,
            matrix(tuple(predicted.tolist())),
            tuple(turned.tolist()),
            (params.up, params.north),
        ),
        updates=state.updates + 1,
        field_stamp=seen.stamp if seen.has_field else state.field_stamp,
        adaptive=state.adaptive,
    ), flags


def adaptive_errors(known: JointCovariance, means: Means, up: float) -> Errors:
    """Return what `adaptive.estimate_errors` returns, by one update of all twelve states.

    Linear acceleration [m/s²] and the field's turn [rad] are states whose variance is all the
    noise there is.
    """
    force, field, rest = means.force, means.field, means.rest
    prior = np.zeros((12, 12))
    prior[:6, :6] = _matrix_of(known)
    prior[6:, 6:] = np.diag([max(force.variance, 0.0)] * 3 + [max(field.variance, 0.0)] * 3)
    h, noise = np.zeros((6, 12)), np.zeros(6)
    pull = up * GRAVITY
    h[0, [1, 6]], h[1, [0, 7]], h[2, [2, 11]] = (pull, 1.0), (-pull, 1.0), (-1.0, 1.0)
    h[3:, 3:6] = rest.directions
    noise[3:] = rest.variance
    z = np.array([*force.acceleration[:2], field.east, *rest.error])
    present = [force.variance > 0] * 2 + [field.variance > 0] + [v > 0 for v in rest.variance]
    x, p = _kalman_update(prior, h, np.diag(noise), z, present, np.inf)
    errors = x[:6].tolist()
    return Errors(
        orientation=tuple(errors[:3]), bias=tuple(errors[3:]), covariance=_joint_of(p[:6, :6])
    )


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
    return JointCovariance(orientation=tuple(t), cross=(c0, c1, c2), bias=tuple(b))


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
    noise, learns = params.noise, params.learn_bias
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


def run(recording: ImuRecording, params: Params, *, details: bool = False) -> OrientationResult:
    """Return attitude, covariance, bias and flags of every row, as `filter.run`."""
    result = empty_result(recording.stamp, details=details)
    state = initial_state()
    columns = (recording.angular_velocity, recording.linear_acceleration, recording.magnetic_field)
    for i, (stamp, *vectors) in enumerate(
        zip(recording.stamp.tolist(), *(c.tolist() for c in columns), strict=True)
    ):
        state, found = update(state, params, Sample(stamp, *(tuple(v) for v in vectors)))
        started = not found.flags & NOT_STARTED
        result.flags[i] = found.flags
        result.orientation[i] = found.orientation if started else np.nan
        result.compact_covariance[i] = found.covariance if started else np.nan
        result.bias[i] = state.bias if started else np.nan
        if details:
            _write_details(result, i, state)
    return result


def _write_details(result: OrientationResult, i: int, state: State) -> None:
    """Fill row i of the columns that were asked for."""
    for column, value in (
        (result.linear_acceleration, state.linear_acceleration),
        (result.magnetic_disturbance, np.array(state.magnetic_disturbance) / MICROTESLA_PER_TESLA),
        (result.inclination, atan2(state.dip[1], state.dip[0])),
    ):
        if column is not None:
            column[i] = value
