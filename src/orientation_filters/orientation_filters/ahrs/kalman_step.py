# SPDX-License-Identifier: Apache-2.0
"""Kalman step of the technical note: at every sample, in the sensor frame, unrolled by axis.

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

from math import sqrt
from typing import NamedTuple

from orientation_filters.ahrs.state import MICROTESLA_PER_TESLA, Noise, Params, State, Variances
from orientation_filters.kernel import inline
from orientation_filters.result import JAMMED
from orientation_filters.rotation.scalars import (
    ZERO,
    Matrix,
    Quaternion,
    Symmetric,
    Vector,
    add,
    apply_symmetric,
    cross,
    dot,
    from_rotation_vector,
    inverse_symmetric,
    matrix,
    multiply,
    normalised,
    scale,
    subtract,
    times,
    transform,
)
from orientation_filters.sample_checks import GRAVITY, CheckedSample
from orientation_filters.slow_attitude import follow


class Prior(NamedTuple):
    """Error covariance before an update: P⁻, all else is zero."""

    variances: Variances
    coupling: Vector
    """Covariances of θ and b of one axis [rad²/s]."""


class Innovation(NamedTuple):
    """Expected gravity and field, and the samples' differences from them."""

    gravity: Vector
    """Expected, sensor frame [m/s²]."""
    field: Vector
    """Expected, sensor frame [µT]."""
    z_gravity: Vector
    z_field: Vector
    has_gravity: bool
    has_field: bool


class Combination(NamedTuple):
    """The observed combination of errors u = −θ + κ b, per axis."""

    variance: Vector
    with_orientation: Vector
    """Covariance of u and θ."""
    with_bias: Vector
    """Covariance of u and b."""


class ErrorEstimate(NamedTuple):
    """Errors x⁺, to be subtracted from the nominal state, and the diagonal of P⁺."""

    orientation: Vector
    bias: Vector
    acceleration: Vector
    disturbance: Vector
    jammed: bool
    variances: Variances


@inline
def kalman_update(
    state: State, params: Params, seen: CheckedSample, predicted: Quaternion, flags: int
) -> tuple[State, int]:
    """Return state and flags after a sample that is compared with the predicted attitude."""
    acceleration = scale(params.noise.linear_acceleration_decay, state.linear_acceleration)
    prior = _predict(state, params, seen.interval)
    rows = matrix(predicted)
    innovation = _innovation(state, params, seen, rows, acceleration)
    limit = 2.0 * params.field_strength
    c = measurement_update(prior, innovation, params.noise, seen.interval, limit)
    q = normalised(multiply(predicted, from_rotation_vector(scale(-1.0, c.orientation))))
    unbiased = scale(-seen.interval, state.bias)
    turned = transform(rows, subtract(unbiased, c.orientation))
    dip = state.dip
    if c.jammed:
        flags |= JAMMED
    elif seen.has_field:
        dip = _corrected_dip(q, params, dip, c.disturbance)
    bias_variance = c.variances.bias if params.learn_bias else state.variances.bias
    return State(
        stamp=seen.stamp,
        orientation=q,
        bias=subtract(state.bias, c.bias),
        linear_acceleration=subtract(acceleration, c.acceleration),
        magnetic_disturbance=c.disturbance if seen.has_field else state.magnetic_disturbance,
        dip=dip,
        variances=_with_bias(c.variances, bias_variance),
        slow=follow(state.slow, seen, rows, turned, (params.up, params.north)),
        updates=state.updates + 1,
        field_stamp=seen.stamp if seen.has_field else state.field_stamp,
        adaptive=state.adaptive,
    ), flags


@inline
def _predict(state: State, params: Params, k: float) -> Prior:
    """Return the covariance after k [s]; a bias that is not learned has none."""
    variances, coupling = state.variances, ZERO
    if not params.learn_bias:
        variances = _with_bias(variances, ZERO)
    if state.updates > 0:
        variances, coupling = _predict_variances(variances, params.noise, k)
    if not params.learn_bias:
        variances, coupling = _with_bias(variances, ZERO), ZERO
    return Prior(variances=variances, coupling=coupling)


@inline
def _predict_variances(after: Variances, noise: Noise, k: float) -> tuple[Variances, Vector]:
    """Return the prior of the next update after k [s], and the covariances of θ and b."""
    t, b, a, d = after.orientation, after.bias, after.acceleration, after.disturbance
    beta, eta = noise.gyroscope_drift, noise.gyroscope
    kk = k * k
    fade_a = noise.linear_acceleration_decay * noise.linear_acceleration_decay
    fade_d = noise.magnetic_disturbance_decay * noise.magnetic_disturbance_decay
    xi, gamma = noise.linear_acceleration, noise.magnetic_disturbance
    prior = Variances(
        orientation=(
            t[0] + kk * (b[0] + beta + eta),
            t[1] + kk * (b[1] + beta + eta),
            t[2] + kk * (b[2] + beta + eta),
        ),
        bias=(b[0] + beta, b[1] + beta, b[2] + beta),
        acceleration=(fade_a * a[0] + xi, fade_a * a[1] + xi, fade_a * a[2] + xi),
        disturbance=(fade_d * d[0] + gamma, fade_d * d[1] + gamma, fade_d * d[2] + gamma),
    )
    return prior, (-k * (b[0] + beta), -k * (b[1] + beta), -k * (b[2] + beta))


@inline
def _with_bias(v: Variances, bias: Vector) -> Variances:
    """Return the variances with that of the bias replaced; zero: the bias is not learned."""
    return Variances(
        orientation=v.orientation,
        bias=bias,
        acceleration=v.acceleration,
        disturbance=v.disturbance,
    )


@inline
def _innovation(
    state: State, params: Params, seen: CheckedSample, rows: Matrix, acceleration: Vector
) -> Innovation:
    """Return the innovations about the expected linear acceleration [m/s²], gravity and field."""
    down = scale(-params.up, rows[2])
    gravity = scale(GRAVITY, down)
    field = _expected_field(rows, down, params, state.dip)
    z_gravity, z_field = ZERO, ZERO
    if seen.has_force:
        z_gravity = subtract(subtract(acceleration, seen.linear_acceleration), gravity)
    if seen.has_field:
        z_field = subtract(scale(MICROTESLA_PER_TESLA, seen.magnetic_field), field)
    return Innovation(
        gravity=gravity,
        field=field,
        z_gravity=z_gravity,
        z_field=z_field,
        has_gravity=seen.has_force,
        has_field=seen.has_field,
    )


@inline
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


@inline
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


@inline
def measurement_update(
    prior: Prior, seen: Innovation, noise: Noise, k: float, jam_limit: float
) -> ErrorEstimate:
    """Return the errors and variances after the innovations of one sample, k [s] after the last.

    A sensor without a sample has weight zero. The magnetometer is ignored where the estimated
    disturbance is longer than `jam_limit` [µT]; gain and covariance stay as if it were not.
    """
    g, m, v = seen.gravity, seen.field, prior.variances
    w_g, w_m = _weights(v, seen, noise, k)
    combination = _combination(prior, k)
    c = _posterior_of_combination(combination.variance, g, w_g, m, w_m)
    y_g = cross(times(w_g, seen.z_gravity), g)
    u = apply_symmetric(c, add(y_g, cross(times(w_m, seen.z_field), m)))
    disturbance = scale(-1.0, _regress_noise(times(v.disturbance, w_m), seen.z_field, m, u))
    jammed = dot(disturbance, disturbance) > jam_limit * jam_limit
    if jammed:
        u = apply_symmetric(c, y_g)
    return ErrorEstimate(
        orientation=_regress(combination.with_orientation, combination.variance, u),
        bias=_regress(combination.with_bias, combination.variance, u),
        acceleration=_regress_noise(times(v.acceleration, w_g), seen.z_gravity, g, u),
        disturbance=disturbance,
        jammed=jammed,
        variances=Variances(
            orientation=_posterior(v.orientation, combination.with_orientation, combination, c),
            bias=_posterior(v.bias, combination.with_bias, combination, c),
            acceleration=_posterior_of_noise(v.acceleration, w_g, _spread(c, g)),
            disturbance=_posterior_of_noise(v.disturbance, w_m, _spread(c, m)),
        ),
    )


@inline
def _weights(v: Variances, seen: Innovation, noise: Noise, k: float) -> tuple[Vector, Vector]:
    """Return 1 / (P_a + R_g) and 1 / (P_d + R_m) per axis; zero without a sample."""
    a, d = v.acceleration, v.disturbance
    gyroscope = k * k * (noise.gyroscope_drift + noise.gyroscope)
    r_g = noise.accelerometer + noise.linear_acceleration + gyroscope
    r_m = noise.magnetometer + noise.magnetic_disturbance + gyroscope
    w_g, w_m = ZERO, ZERO
    if seen.has_gravity:
        w_g = (1.0 / (a[0] + r_g), 1.0 / (a[1] + r_g), 1.0 / (a[2] + r_g))
    if seen.has_field:
        w_m = (1.0 / (d[0] + r_m), 1.0 / (d[1] + r_m), 1.0 / (d[2] + r_m))
    return w_g, w_m


@inline
def _combination(prior: Prior, k: float) -> Combination:
    """Return variance and covariances of u = −θ + k b."""
    t, b, c = prior.variances.orientation, prior.variances.bias, prior.coupling
    return Combination(
        variance=(
            t[0] - 2.0 * k * c[0] + k * k * b[0],
            t[1] - 2.0 * k * c[1] + k * k * b[1],
            t[2] - 2.0 * k * c[2] + k * k * b[2],
        ),
        with_orientation=(k * c[0] - t[0], k * c[1] - t[1], k * c[2] - t[2]),
        with_bias=(k * b[0] - c[0], k * b[1] - c[1], k * b[2] - c[2]),
    )


@inline
def _posterior_of_combination(
    s: Vector, gravity: Vector, w_g: Vector, field: Vector, w_m: Vector
) -> Symmetric:
    """Return the covariance of u after both measurements: the inverse of all information."""
    i_g, i_m = _information(w_g, gravity), _information(w_m, field)
    return inverse_symmetric(
        (
            1.0 / s[0] + i_g[0] + i_m[0],
            i_g[1] + i_m[1],
            i_g[2] + i_m[2],
            1.0 / s[1] + i_g[3] + i_m[3],
            i_g[4] + i_m[4],
            1.0 / s[2] + i_g[5] + i_m[5],
        )
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
def _regress(p: Vector, s: Vector, u: Vector) -> Vector:
    """Return the errors whose covariance with u, of variance s, is p."""
    return p[0] / s[0] * u[0], p[1] / s[1] * u[1], p[2] / s[2] * u[2]


@inline
def _regress_noise(gain: Vector, z: Vector, v: Vector, u: Vector) -> Vector:
    """Return gain · (z − v × u): the part of an innovation that is not rotation."""
    return times(gain, subtract(z, cross(v, u)))


@inline
def _posterior(prior: Vector, p: Vector, of: Combination, c: Symmetric) -> Vector:
    """Return the variances of errors whose covariance with u is p, u's falling from s to c."""
    s = of.variance
    return (
        prior[0] - p[0] * p[0] / s[0] + (p[0] / s[0]) * (p[0] / s[0]) * c[0],
        prior[1] - p[1] * p[1] / s[1] + (p[1] / s[1]) * (p[1] / s[1]) * c[3],
        prior[2] - p[2] * p[2] / s[2] + (p[2] / s[2]) * (p[2] / s[2]) * c[5],
    )


@inline
def _posterior_of_noise(prior: Vector, weight: Vector, spread: Vector) -> Vector:
    """Return the variances of a or d, observed with `weight` = 1 / (prior + R)."""
    k0, k1, k2 = prior[0] * weight[0], prior[1] * weight[1], prior[2] * weight[2]
    return (
        prior[0] - prior[0] * k0 + k0 * k0 * spread[0],
        prior[1] - prior[1] * k1 + k1 * k1 * spread[1],
        prior[2] - prior[2] * k2 + k2 * k2 * spread[2],
    )


@inline
def _spread(c: Symmetric, v: Vector) -> Vector:
    """Return the diagonal of [v]× C [v]×ᵀ."""
    return (
        v[2] * v[2] * c[3] - 2.0 * v[1] * v[2] * c[4] + v[1] * v[1] * c[5],
        v[2] * v[2] * c[0] - 2.0 * v[0] * v[2] * c[2] + v[0] * v[0] * c[5],
        v[1] * v[1] * c[0] - 2.0 * v[0] * v[1] * c[1] + v[0] * v[0] * c[3],
    )
