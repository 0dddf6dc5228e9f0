# SPDX-License-Identifier: Apache-2.0
"""Complementary filter of fixed gain: parameters, state, corrections of the attitude, bias.

Accelerometer and magnetometer turn the attitude by the gains of first-order low-passes. The bias
is learned from the mean rate at rest, in motion by integral action on those corrections.
"""

from __future__ import annotations

from math import exp, sqrt
from typing import NamedTuple

from orientation_filters.complementary.adaptive import AdaptiveGainState, no_adaptation
from orientation_filters.kernel import inline
from orientation_filters.rest_detection import (
    RestParams,
    RestState,
    is_bias,
    start_rest,
    update_rest,
)
from orientation_filters.result import AT_REST, BIAS_LIMITED
from orientation_filters.rotation.scalars import (
    IDENTITY,
    ZERO,
    Matrix,
    Quaternion,
    Symmetric,
    Vector,
    approach,
    dot,
    heading_error,
    inclination_error,
    multiply,
    scale,
    subtract,
    to_sensor,
    transform,
)
from orientation_filters.sample_checks import CheckedSample, SampleParams
from orientation_filters.slow_attitude import (
    SlowAttitude,
    distance_variances,
    start_slow,
    unobserved_heading_variance,
)
from orientation_filters.step_averages.accumulation import AveragingParams


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
    bias_sigma: float
    """Standard deviation of the remaining gyroscope bias [rad/s]."""
    inclination_sigma: float
    """Lasting error of specific force as a vertical [rad]."""
    heading_sigma: float
    """Lasting error of the magnetic field as a heading [rad]."""
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
    slow: SlowAttitude
    """Second attitude, from which the error of fixed gains is estimated."""
    age: float
    """Since the attitude was set [s]."""
    field_stamp: int
    """Of the last magnetometer sample [ns]; −1 before the first."""
    rest: RestState
    disturbance: float
    """Distance of the field from the reference [T]; adaptive only."""
    adaptive: AdaptiveGainState


ADAPTIVE_STATE = ('bias', 'rest', 'disturbance', 'adaptive')
"""Fields of the state that are unused where the filter neither adapts nor learns."""
FIXED_STATE = ('slow', 'age', 'rest')
"""Fields of the state that the adaptive filter does not use."""


def initial_state() -> State:
    """Return the state before the first sample."""
    return State(
        stamp=-1,
        orientation=IDENTITY,
        bias=ZERO,
        slow=start_slow(),
        age=0.0,
        field_stamp=-1,
        rest=start_rest(ZERO, ZERO, ZERO),
        disturbance=0.0,
        adaptive=no_adaptation(),
    )


class InclinationCorrection(NamedTuple):
    """Rotation about the world's x and y towards specific force upward."""

    x: float
    """[rad]"""
    y: float
    """[rad]"""
    gain: float
    """Part of the rotation that is done."""


class HeadingCorrection(NamedTuple):
    """Rotation about the world's z towards magnetic north."""

    z: float
    """[rad]"""
    gain: float
    """Part of the rotation that is done."""


@inline
def inclination_correction(
    params: Params, seen: CheckedSample, rows: Matrix
) -> InclinationCorrection:
    """Return the rotation to specific force upward; `rows`: attitude, sensor → world."""
    if not seen.has_force:
        return InclinationCorrection(x=0.0, y=0.0, gain=0.0)
    f = seen.linear_acceleration
    upward = transform(rows, scale(1.0 / sqrt(dot(f, f)), f))
    x, y = inclination_error(upward, params.up)
    return InclinationCorrection(x=x, y=y, gain=_gain(params.inclination_rate, seen.interval))


@inline
def heading_correction(
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
    return HeadingCorrection(z=heading_error(m, level, params.north), gain=gain)


@inline
def correct(
    before: Quaternion,
    predicted: Quaternion,
    tilt: InclinationCorrection,
    turn: HeadingCorrection,
) -> Quaternion:
    """Return the prediction turned in the world by both corrections, of nearly unit length.

    It is rescaled by the squared length of the attitude before, to first order: the next sample
    does not have to wait for square root and division. Its length differs from 1 by no more than
    the square of half a correction.
    """
    square = before[0] ** 2 + before[1] ** 2 + before[2] ** 2 + before[3] ** 2
    factor = 1.5 - 0.5 * square
    half_tilt, half_turn = 0.5 * factor * tilt.gain, 0.5 * factor * turn.gain
    return multiply(
        (half_tilt * tilt.x, half_tilt * tilt.y, half_turn * turn.z, factor), predicted
    )


@inline
def fixed_gain_covariance(state: State, params: Params) -> Symmetric:
    """Return xx, xy, xz, yy, yz, zz of the orientation error about the world's axes [rad²]."""
    tilt, turn = distance_variances(state.slow)
    tilt += params.inclination_sigma * params.inclination_sigma
    turn += params.heading_sigma * params.heading_sigma
    turn += unobserved_heading_variance(
        state.stamp, state.field_stamp, params.bias_sigma * params.bias_sigma
    )
    return tilt, 0.0, 0.0, tilt, 0.0, turn


@inline
def _gain(rate: float, dt: float) -> float:
    """Return 1 − exp(−rate · dt)."""
    x = rate * dt
    if x > 0.5:
        return 1.0 - exp(-x)
    square = x * x
    return x / (1.0 + 0.5 * x + square * (1 / 12 - square * (1 / 720 - square * (1 / 30240))))


@inline
def learned_bias(
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
