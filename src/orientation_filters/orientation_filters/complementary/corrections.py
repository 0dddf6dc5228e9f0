# SPDX-License-Identifier: Apache-2.0
"""What accelerometer and magnetometer turn the attitude by, and what that leaves of its error.

Gains are fixed: those of first-order low-passes. Errors are of two kinds: noise, which the gain
averages, and a bias of the gyroscope that is not known, behind which the attitude lags.
"""

from __future__ import annotations

from math import exp, sqrt
from typing import NamedTuple

from orientation_filters.complementary.state import Params, State
from orientation_filters.kernel import inline
from orientation_filters.rotation.scalars import (
    Matrix,
    Quaternion,
    Symmetric,
    Vector,
    dot,
    multiply,
    scale,
    transform,
)
from orientation_filters.sample_checks import GRAVITY, CheckedSample

PER_GRAVITY = 1.0 / GRAVITY


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


@inline
def inclination_correction(
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
    return HeadingCorrection(z=_heading_error(m, level, params.north), gain=gain)


@inline
def correct(
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
def propagate_errors(
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
def fixed_gain_covariance(state: State) -> Symmetric:
    """Return xx, xy, xz, yy, yz, zz of the orientation error about the world's axes [rad²]."""
    tilt = state.variance[0] + state.lag[0] * state.lag[0]
    turn = state.variance[1] + state.lag[1] * state.lag[1]
    return tilt, 0.0, 0.0, tilt, 0.0, turn


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
