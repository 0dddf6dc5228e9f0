# SPDX-License-Identifier: Apache-2.0
"""What accelerometer and magnetometer turn the attitude by, their gains those of low-passes."""

from __future__ import annotations

from math import exp, sqrt
from typing import NamedTuple

from orientation_filters.complementary.state import Params, State
from orientation_filters.kernel import inline
from orientation_filters.rotation.scalars import (
    Matrix,
    Quaternion,
    Symmetric,
    dot,
    heading_error,
    inclination_error,
    multiply,
    scale,
    transform,
)
from orientation_filters.sample_checks import CheckedSample
from orientation_filters.slow_attitude import distance_variances, heading_doubt


class InclinationCorrection(NamedTuple):
    """Rotation about the world's x and y that the accelerometer asks for."""

    x: float
    """To specific force upward [rad]."""
    y: float
    gain: float
    """Part of the rotation that is done."""


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
def fixed_gain_covariance(state: State, params: Params) -> Symmetric:
    """Return xx, xy, xz, yy, yz, zz of the orientation error about the world's axes [rad²]."""
    tilt, turn = distance_variances(state.slow)
    tilt += params.inclination_sigma * params.inclination_sigma
    turn += params.heading_sigma * params.heading_sigma
    turn += heading_doubt(state.stamp, state.field_stamp, params.bias_sigma * params.bias_sigma)
    return tilt, 0.0, 0.0, tilt, 0.0, turn


@inline
def _gain(rate: float, dt: float) -> float:
    """Return 1 − exp(−rate · dt)."""
    x = rate * dt
    if x > 0.5:
        return 1.0 - exp(-x)
    square = x * x
    return x / (1.0 + 0.5 * x + square * (1 / 12 - square * (1 / 720 - square * (1 / 30240))))
