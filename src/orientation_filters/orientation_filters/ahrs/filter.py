# SPDX-License-Identifier: Apache-2.0
"""AHRS: 12-state indirect Kalman filter for accelerometer, gyroscope and magnetometer.

Equations: NXP Semiconductors, Sensor Fusion Kalman filters technical note (CC BY 4.0), for which
MathWorks' ahrsfilter documents parameters and defaults; ENU and NED. Magnetic quantities are in
µT inside, as the documented noises are. The Kalman step is the note's, at every sample
(`kalman_step`), or the adaptive one on means between steps (`adaptive`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from imu_recording.recording import ImuRecording

from orientation_filters.ahrs.adaptive import adaptive_update, start_adaptive
from orientation_filters.ahrs.kalman_step import kalman_update
from orientation_filters.ahrs.state import (
    ADAPTIVE_STATE,
    FIXED_STATE,
    INITIAL_VARIANCES,
    MICROTESLA_PER_TESLA,
    Params,
    State,
    initial_state,
)
from orientation_filters.kernel import inline, kernel
from orientation_filters.result import (
    DROPPED,
    INVALID_GYROSCOPE,
    JUMPED_BACK,
    NOT_STARTED,
    REINITIALISED,
    Estimate,
    OrientationResult,
    ResultColumns,
    empty_result,
)
from orientation_filters.rotation.scalars import (
    UNKNOWN_QUATERNION,
    UNKNOWN_SYMMETRIC,
    UNKNOWN_VECTOR,
    ZERO,
    Quaternion,
    Symmetric,
    Vector,
    attitude_from_vectors,
    matrix,
    subtract,
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
from orientation_filters.slow_attitude import (
    distance_variances,
    start_slow,
    unobserved_heading_variance,
)
from orientation_filters.step_averages.accumulation import held, integrate

__all__ = ['ADAPTIVE_STATE', 'FIXED_STATE', 'Params', 'State', 'initial_state', 'run', 'update']


@kernel
def update(state: State, params: Params, sample: Sample) -> tuple[State, Estimate]:
    """Return state and estimate after a sample."""
    state, flags = _update(state, params, sample)
    return state, estimate(state, params, sample.stamp, flags)


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
def _update(state: State, params: Params, sample: Sample) -> tuple[State, int]:
    """Return state and flags after a sample."""
    seen, flags = check_sample(sample, state.stamp, state.field_stamp, params.samples)
    if flags & DROPPED:
        return state, flags
    if flags & REINITIALISED:
        return start(state, params, seen, flags)
    if params.adaptive:
        predicted = integrate(state.orientation, state.bias, state.adaptive.averages, seen)
        return adaptive_update(state, params, seen, predicted, flags)
    rate = subtract(seen.angular_velocity, state.bias)
    predicted = turned_at(state.orientation, rate, seen.interval)
    return kalman_update(state, params, seen, predicted, flags)


@inline
def start(state: State, params: Params, seen: CheckedSample, flags: int) -> tuple[State, int]:
    """Set the attitude from one specific force and field; only a jump back resets the bias."""
    q = state.orientation
    if seen.has_force:
        f, m = seen.linear_acceleration, seen.magnetic_field
        q = attitude_from_vectors(f, m, params.up, params.north)
    else:
        flags |= NOT_STARTED
    adaptive = state.adaptive
    if params.adaptive:
        adaptive = start_adaptive(adaptive, params.averaging, seen, flags)
    return State(
        stamp=seen.stamp if seen.has_force else -1,
        orientation=q,
        bias=ZERO if flags & JUMPED_BACK else state.bias,
        linear_acceleration=ZERO,
        magnetic_disturbance=ZERO,
        dip=(1.0, 0.0),
        variances=INITIAL_VARIANCES,
        slow=start_slow(),
        updates=0,
        field_stamp=seen.stamp if seen.has_force and seen.has_field else -1,
        adaptive=adaptive,
    ), flags


@inline
def estimate(state: State, params: Params, stamp: int, flags: int) -> Estimate:
    """Return the estimate at a stamp [ns]; without a rate the last one carries it on."""
    q, covariance = state.orientation, _covariance(state)
    if params.adaptive and flags & INVALID_GYROSCOPE and stamp > state.stamp:
        interval = 1e-9 * (stamp - state.stamp)
        q, covariance = held(q, state.bias, covariance, state.adaptive.averages, interval)
    return Estimate(orientation=q, covariance=covariance, flags=flags)


@inline
def _covariance(state: State) -> Symmetric:
    """Return xx, xy, xz, yy, yz, zz of the orientation error about the world's axes [rad²]."""
    if state.adaptive.shown[0] > 0.0:
        return state.adaptive.shown
    v, b = state.variances.orientation, state.variances.bias
    tilt, turn = distance_variances(state.slow)
    turn += unobserved_heading_variance(state.stamp, state.field_stamp, (b[0] + b[1] + b[2]) / 3.0)
    x, y, z = matrix(state.orientation)
    return (
        x[0] * x[0] * v[0] + x[1] * x[1] * v[1] + x[2] * x[2] * v[2] + tilt,
        x[0] * y[0] * v[0] + x[1] * y[1] * v[1] + x[2] * y[2] * v[2],
        x[0] * z[0] * v[0] + x[1] * z[1] * v[1] + x[2] * z[2] * v[2],
        y[0] * y[0] * v[0] + y[1] * y[1] * v[1] + y[2] * y[2] * v[2] + tilt,
        y[0] * z[0] * v[0] + y[1] * z[1] * v[1] + y[2] * z[2] * v[2],
        z[0] * z[0] * v[0] + z[1] * z[1] * v[1] + z[2] * z[2] * v[2] + turn,
    )


def run(recording: ImuRecording, params: Params, *, details: bool = False) -> OrientationResult:
    """Return attitude, covariance, bias and flags of every row; `details`: other states."""
    result = empty_result(recording.stamp, details=details)
    _run(initial_state(), params, sample_columns(recording), result.columns())
    return result


@kernel
def _run(state: State, params: Params, samples: SampleColumns, result: ResultColumns) -> None:
    for i in range(len(samples.stamp)):
        state, flags = _update(state, params, sample_of(samples, i))
        if flags:
            result.flags[i] = flags
        shown = estimate(state, params, samples.stamp[i], flags)
        q, c, b = shown.orientation, shown.covariance, state.bias
        if flags & NOT_STARTED:
            q, c, b = UNKNOWN_QUATERNION, UNKNOWN_SYMMETRIC, UNKNOWN_VECTOR
        for k in range(4):
            result.orientation[i, k] = q[k]
        for k in range(6):
            result.compact_covariance[i, k] = c[k]
        for k in range(3):
            result.bias[i, k] = b[k]
        if len(result.inclination):
            for k in range(3):
                result.linear_acceleration[i, k] = state.linear_acceleration[k]
                result.magnetic_disturbance[i, k] = (
                    state.magnetic_disturbance[k] / MICROTESLA_PER_TESLA
                )
            result.inclination[i] = np.arctan2(state.dip[1], state.dip[0])
