# SPDX-License-Identifier: Apache-2.0
"""Joint covariance of orientation error θ (world) and gyroscope bias error b (sensor).

The Kalman filter's prediction and its scalar measurements, unrolled: independent measurements
taken one after the other give what the matrix form gives.
"""

from __future__ import annotations

from typing import NamedTuple

from orientation_filters.kernel import inline
from orientation_filters.rotation.scalars import (
    ZERO,
    ZERO_SYMMETRIC,
    Matrix,
    Symmetric,
    Vector,
    apply_symmetric,
    dot,
    less,
)


class JointCovariance(NamedTuple):
    """Blocks of the 6×6 covariance."""

    orientation: Symmetric
    """[rad²], world."""
    cross: Matrix
    """Rows θ, columns b."""
    bias: Symmetric
    """[(rad/s)²], sensor."""


class Errors(NamedTuple):
    """Estimated errors and their covariance, measurement after measurement."""

    orientation: Vector
    bias: Vector
    covariance: JointCovariance


@inline
def no_covariance() -> JointCovariance:
    """Return the covariance before any sample."""
    return JointCovariance(
        orientation=ZERO_SYMMETRIC, cross=(ZERO, ZERO, ZERO), bias=ZERO_SYMMETRIC
    )


@inline
def independent(inclination: float, heading: float, bias: float) -> JointCovariance:
    """Return a diagonal covariance [rad², rad², (rad/s)²]."""
    return JointCovariance(
        orientation=(inclination, 0.0, 0.0, inclination, 0.0, heading),
        cross=(ZERO, ZERO, ZERO),
        bias=(bias, 0.0, 0.0, bias, 0.0, bias),
    )


@inline
def predict(p: JointCovariance, f: Matrix, angle: float, bias: float) -> JointCovariance:
    """Return the covariance after θ grew by f · b, with noise variances `angle` and `bias`."""
    b, c = p.bias, p.cross
    g = (apply_symmetric(b, f[0]), apply_symmetric(b, f[1]), apply_symmetric(b, f[2]))
    t = p.orientation
    return JointCovariance(
        orientation=(
            t[0] + 2.0 * dot(f[0], c[0]) + dot(g[0], f[0]) + angle,
            t[1] + dot(f[0], c[1]) + dot(f[1], c[0]) + dot(g[0], f[1]),
            t[2] + dot(f[0], c[2]) + dot(f[2], c[0]) + dot(g[0], f[2]),
            t[3] + 2.0 * dot(f[1], c[1]) + dot(g[1], f[1]) + angle,
            t[4] + dot(f[1], c[2]) + dot(f[2], c[1]) + dot(g[1], f[2]),
            t[5] + 2.0 * dot(f[2], c[2]) + dot(g[2], f[2]) + angle,
        ),
        cross=(
            (c[0][0] + g[0][0], c[0][1] + g[0][1], c[0][2] + g[0][2]),
            (c[1][0] + g[1][0], c[1][1] + g[1][1], c[1][2] + g[1][2]),
            (c[2][0] + g[2][0], c[2][1] + g[2][1], c[2][2] + g[2][2]),
        ),
        bias=(b[0] + bias, b[1], b[2], b[3] + bias, b[4], b[5] + bias),
    )


@inline
def widen(p: JointCovariance, inclination: float, heading: float) -> JointCovariance:
    """Return the covariance of an attitude that may be wrong by these variances [rad²] more."""
    t = p.orientation
    wider = (t[0] + inclination, t[1], t[2], t[3] + inclination, t[4], t[5] + heading)
    return JointCovariance(orientation=wider, cross=p.cross, bias=p.bias)


@inline
def with_independent_bias(p: JointCovariance, bias: Symmetric) -> JointCovariance:
    """Return the covariance with an uncorrelated bias; of zero variance it is never learned."""
    return JointCovariance(orientation=p.orientation, cross=(ZERO, ZERO, ZERO), bias=bias)


@inline
def observe(errors: Errors, h_t: Vector, h_b: Vector, z: float, variance: float) -> Errors:
    """Return the errors after the measurement z = h_t · θ + h_b · b + noise."""
    p = errors.covariance
    c = p.cross
    t, b = apply_symmetric(p.orientation, h_t), apply_symmetric(p.bias, h_b)
    on_t = (t[0] + dot(c[0], h_b), t[1] + dot(c[1], h_b), t[2] + dot(c[2], h_b))
    on_b = (
        b[0] + c[0][0] * h_t[0] + c[1][0] * h_t[1] + c[2][0] * h_t[2],
        b[1] + c[0][1] * h_t[0] + c[1][1] * h_t[1] + c[2][1] * h_t[2],
        b[2] + c[0][2] * h_t[0] + c[1][2] * h_t[1] + c[2][2] * h_t[2],
    )
    weight = 1.0 / (dot(h_t, on_t) + dot(h_b, on_b) + variance)
    k = weight * (z - dot(h_t, errors.orientation) - dot(h_b, errors.bias))
    x_t, x_b = errors.orientation, errors.bias
    return Errors(
        orientation=(x_t[0] + k * on_t[0], x_t[1] + k * on_t[1], x_t[2] + k * on_t[2]),
        bias=(x_b[0] + k * on_b[0], x_b[1] + k * on_b[1], x_b[2] + k * on_b[2]),
        covariance=JointCovariance(
            orientation=less(p.orientation, on_t, weight),
            cross=(
                _row_less(c[0], weight * on_t[0], on_b),
                _row_less(c[1], weight * on_t[1], on_b),
                _row_less(c[2], weight * on_t[2], on_b),
            ),
            bias=less(p.bias, on_b, weight),
        ),
    )


@inline
def _row_less(row: Vector, factor: float, v: Vector) -> Vector:
    """Return row − factor · v."""
    return row[0] - factor * v[0], row[1] - factor * v[1], row[2] - factor * v[2]
