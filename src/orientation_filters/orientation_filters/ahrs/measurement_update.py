# SPDX-License-Identifier: Apache-2.0
"""One measurement update of the 12-state indirect Kalman filter, axis by axis.

The error state is x = [θ, b, a, d]: orientation [rad], gyroscope bias [rad/s], linear
acceleration [m/s²] and magnetic disturbance [µT], all in the sensor frame (NXP sensor fusion
technical note). The prior covariance couples only θ and b of one axis, so the 6×6 innovation
inverse of the textbook

    S = H P⁻ Hᵀ + R,  K = P⁻ Hᵀ S⁻¹,  x⁺ = K z,  P⁺ = P⁻ − K H P⁻

with H = [−[g]×, κ[g]×, I, 0; −[m]×, κ[m]×, 0, −I] reduces, exactly, to a 3×3 inverse for
u = −θ + κ b: z_g = [g]× u + a and z_m = [m]× u − d observe u through noises of variance
P_a + R_g and P_d + R_m, and θ, b, a, d follow from u by regression.
"""

from __future__ import annotations

from typing import NamedTuple

from orientation_filters.kernel import inline
from orientation_filters.rotation.scalars import Vector, add, cross, dot

Symmetric = tuple[float, float, float, float, float, float]
"""xx, xy, xz, yy, yz, zz."""


class Noise(NamedTuple):
    """Variances per step, names and units as MathWorks' ahrsfilter documents them."""

    accelerometer: float
    """[(m/s²)²]"""
    magnetometer: float
    """[µT²]"""
    gyroscope: float
    """[(rad/s)²]"""
    gyroscope_drift: float
    """[(rad/s)²]"""
    linear_acceleration: float
    """[(m/s²)²]"""
    linear_acceleration_decay: float
    """Part of the linear acceleration left after a step."""
    magnetic_disturbance: float
    """[µT²]"""
    magnetic_disturbance_decay: float
    """Part of the disturbance left after a step."""


class Variances(NamedTuple):
    """Diagonal of the error covariance after an update, per axis."""

    orientation: Vector
    """[rad²]"""
    bias: Vector
    """[(rad/s)²]"""
    acceleration: Vector
    """[(m/s²)²]"""
    disturbance: Vector
    """[µT²]"""


INITIAL_VARIANCES = Variances(
    (6.092348e-6, 6.092348e-6, 6.092348e-6),
    (7.615435e-5, 7.615435e-5, 7.615435e-5),
    (9.62361e-3, 9.62361e-3, 9.62361e-3),
    (0.6, 0.6, 0.6),
)
"""Prior of the first update; θ and b are then uncorrelated."""


class Correction(NamedTuple):
    """Errors to be taken from the nominal state, and the covariance that is left."""

    orientation: Vector
    bias: Vector
    acceleration: Vector
    disturbance: Vector
    jammed: bool
    variances: Variances


@inline
def times(a: Vector, b: Vector) -> Vector:
    """Return the product component by component."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@inline
def apply_symmetric(c: Symmetric, v: Vector) -> Vector:
    """Return the symmetric matrix times the vector."""
    return (
        c[0] * v[0] + c[1] * v[1] + c[2] * v[2],
        c[1] * v[0] + c[3] * v[1] + c[4] * v[2],
        c[2] * v[0] + c[4] * v[1] + c[5] * v[2],
    )


@inline
def inverse_symmetric(a: Symmetric) -> Symmetric:
    """Return the inverse of a positive definite symmetric 3×3 matrix."""
    c0 = a[3] * a[5] - a[4] * a[4]
    c1 = a[2] * a[4] - a[1] * a[5]
    c2 = a[1] * a[4] - a[2] * a[3]
    scale = 1.0 / (a[0] * c0 + a[1] * c1 + a[2] * c2)
    return (
        c0 * scale,
        c1 * scale,
        c2 * scale,
        (a[0] * a[5] - a[2] * a[2]) * scale,
        (a[1] * a[2] - a[0] * a[4]) * scale,
        (a[0] * a[3] - a[1] * a[1]) * scale,
    )


@inline
def _information(w: Vector, v: Vector) -> Symmetric:
    """Return [v]×ᵀ diag(w) [v]×."""
    return (
        v[2] * v[2] * w[1] + v[1] * v[1] * w[2],
        -v[0] * v[1] * w[2],
        -v[0] * v[2] * w[1],
        v[2] * v[2] * w[0] + v[0] * v[0] * w[2],
        -v[1] * v[2] * w[0],
        v[1] * v[1] * w[0] + v[0] * v[0] * w[1],
    )


@inline
def _spread(c: Symmetric, v: Vector) -> Vector:
    """Return the diagonal of [v]× C [v]×ᵀ."""
    return (
        v[2] * v[2] * c[3] - 2.0 * v[1] * v[2] * c[4] + v[1] * v[1] * c[5],
        v[2] * v[2] * c[0] - 2.0 * v[0] * v[2] * c[2] + v[0] * v[0] * c[5],
        v[1] * v[1] * c[0] - 2.0 * v[0] * v[1] * c[1] + v[0] * v[0] * c[3],
    )


@inline
def _posterior(prior: Vector, weight: Vector, spread: Vector) -> Vector:
    """Return the variance of a noise state seen with `weight` = 1 / (prior + R)."""
    k0, k1, k2 = prior[0] * weight[0], prior[1] * weight[1], prior[2] * weight[2]
    return (
        prior[0] - prior[0] * k0 + k0 * k0 * spread[0],
        prior[1] - prior[1] * k1 + k1 * k1 * spread[1],
        prior[2] - prior[2] * k2 + k2 * k2 * spread[2],
    )


@inline
def _regressed(prior: float, p: float, s: float, c: float) -> float:
    """Return the variance of a state whose covariance with u is p, u's falling from s to c."""
    return prior - p * p / s + (p / s) * (p / s) * c


@inline
def predict_variances(after: Variances, noise: Noise, k: float) -> tuple[Variances, Vector]:
    """Return the prior of the next update after k [s], and the covariances of θ and b."""
    t, b, a, d = after.orientation, after.bias, after.acceleration, after.disturbance
    beta, eta = noise.gyroscope_drift, noise.gyroscope
    kk = k * k
    fade_a = noise.linear_acceleration_decay * noise.linear_acceleration_decay
    fade_d = noise.magnetic_disturbance_decay * noise.magnetic_disturbance_decay
    xi, gamma = noise.linear_acceleration, noise.magnetic_disturbance
    prior = Variances(
        (
            t[0] + kk * (b[0] + beta + eta),
            t[1] + kk * (b[1] + beta + eta),
            t[2] + kk * (b[2] + beta + eta),
        ),
        (b[0] + beta, b[1] + beta, b[2] + beta),
        (fade_a * a[0] + xi, fade_a * a[1] + xi, fade_a * a[2] + xi),
        (fade_d * d[0] + gamma, fade_d * d[1] + gamma, fade_d * d[2] + gamma),
    )
    return prior, (-k * (b[0] + beta), -k * (b[1] + beta), -k * (b[2] + beta))


@inline
def with_bias(v: Variances, bias: Vector) -> Variances:
    """Return the variances with another one of the bias; zero: nothing is learned about it."""
    return Variances(v.orientation, bias, v.acceleration, v.disturbance)


@inline
def correct(  # noqa: PLR0913, PLR0917 (the measurement equation's own quantities)
    prior: Variances,
    coupling: Vector,
    noise: Noise,
    k: float,
    gravity: Vector,
    z_gravity: Vector,
    has_gravity: bool,
    field: Vector,
    z_field: Vector,
    has_field: bool,
    jam_limit: float,
) -> Correction:
    """Return the update for innovations z about the expected `gravity` [m/s²] and `field` [µT].

    A sensor without a sample has weight zero. The magnetometer is ignored where the estimated
    disturbance is longer than `jam_limit` [µT]; gain and covariance stay as if it were not.
    """
    t, b, a, d = prior.orientation, prior.bias, prior.acceleration, prior.disturbance
    gyroscope = k * k * (noise.gyroscope_drift + noise.gyroscope)
    r_g = noise.accelerometer + noise.linear_acceleration + gyroscope
    r_m = noise.magnetometer + noise.magnetic_disturbance + gyroscope
    s = (
        t[0] - 2.0 * k * coupling[0] + k * k * b[0],
        t[1] - 2.0 * k * coupling[1] + k * k * b[1],
        t[2] - 2.0 * k * coupling[2] + k * k * b[2],
    )
    p = (k * coupling[0] - t[0], k * coupling[1] - t[1], k * coupling[2] - t[2])
    r = (k * b[0] - coupling[0], k * b[1] - coupling[1], k * b[2] - coupling[2])
    w_g, w_m = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if has_gravity:
        w_g = (1.0 / (a[0] + r_g), 1.0 / (a[1] + r_g), 1.0 / (a[2] + r_g))
    if has_field:
        w_m = (1.0 / (d[0] + r_m), 1.0 / (d[1] + r_m), 1.0 / (d[2] + r_m))
    i_g, i_m = _information(w_g, gravity), _information(w_m, field)
    c = inverse_symmetric(
        (
            1.0 / s[0] + i_g[0] + i_m[0],
            i_g[1] + i_m[1],
            i_g[2] + i_m[2],
            1.0 / s[1] + i_g[3] + i_m[3],
            i_g[4] + i_m[4],
            1.0 / s[2] + i_g[5] + i_m[5],
        )
    )
    y_g = cross(times(w_g, z_gravity), gravity)
    u = apply_symmetric(c, add(y_g, cross(times(w_m, z_field), field)))
    m_u = cross(field, u)
    k_d = times(d, w_m)
    disturbance = (
        -k_d[0] * (z_field[0] - m_u[0]),
        -k_d[1] * (z_field[1] - m_u[1]),
        -k_d[2] * (z_field[2] - m_u[2]),
    )
    jammed = dot(disturbance, disturbance) > jam_limit * jam_limit
    if jammed:
        u = apply_symmetric(c, y_g)
    g_u = cross(gravity, u)
    k_a = times(a, w_g)
    acceleration = (
        k_a[0] * (z_gravity[0] - g_u[0]),
        k_a[1] * (z_gravity[1] - g_u[1]),
        k_a[2] * (z_gravity[2] - g_u[2]),
    )
    after = Variances(
        (
            _regressed(t[0], p[0], s[0], c[0]),
            _regressed(t[1], p[1], s[1], c[3]),
            _regressed(t[2], p[2], s[2], c[5]),
        ),
        (
            _regressed(b[0], r[0], s[0], c[0]),
            _regressed(b[1], r[1], s[1], c[3]),
            _regressed(b[2], r[2], s[2], c[5]),
        ),
        _posterior(a, w_g, _spread(c, gravity)),
        _posterior(d, w_m, _spread(c, field)),
    )
    return Correction(
        (p[0] / s[0] * u[0], p[1] / s[1] * u[1], p[2] / s[2] * u[2]),
        (r[0] / s[0] * u[0], r[1] / s[1] * u[1], r[2] / s[2] * u[2]),
        acceleration,
        disturbance,
        jammed,
        after,
    )
