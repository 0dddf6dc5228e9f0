# SPDX-License-Identifier: Apache-2.0
"""Vectors, quaternions and 3×3 matrices as tuples of scalars, for compiled kernels.

Quaternions are (x, y, z, w), Hamilton, sensor → world, as `sensor_msgs/Imu.orientation`. The
same algebra on arrays is in `arrays`.
"""

from __future__ import annotations

from math import asin, atan2, copysign, cos, isfinite, nan, sin, sqrt

from orientation_filters.kernel import inline

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Matrix = tuple[Vector, Vector, Vector]
Symmetric = tuple[float, float, float, float, float, float]
"""xx, xy, xz, yy, yz, zz of a symmetric 3×3 matrix."""

ZERO = (0.0, 0.0, 0.0)
IDENTITY = (0.0, 0.0, 0.0, 1.0)
ZERO_SYMMETRIC = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
UNKNOWN_VECTOR = (nan, nan, nan)
UNKNOWN_QUATERNION = (nan, nan, nan, nan)
UNKNOWN_SYMMETRIC = (nan, nan, nan, nan, nan, nan)

SERIES_LIMIT = 0.04
"""Square of the rotation angle [rad²] below which the series is exact to rounding."""


@inline
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@inline
def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inline
def subtract(a: Vector, b: Vector) -> Vector:
    """Return a − b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inline
def scale(factor: float, a: Vector) -> Vector:
    """Return factor · a."""
    return factor * a[0], factor * a[1], factor * a[2]


@inline
def approach(a: Vector, b: Vector, gain: float) -> Vector:
    """Return a + gain · (b − a), one step of a first-order low-pass."""
    return a[0] + gain * (b[0] - a[0]), a[1] + gain * (b[1] - a[1]), a[2] + gain * (b[2] - a[2])


@inline
def absent(v: Vector) -> bool:
    """Whether every component is NaN: a row without a sample."""
    return v[0] != v[0] and v[1] != v[1] and v[2] != v[2]


@inline
def times(a: Vector, b: Vector) -> Vector:
    """Return the product component by component."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@inline
def multiply(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the Hamilton product p ⊗ q."""
    return (
        p[3] * q[0] + p[0] * q[3] + p[1] * q[2] - p[2] * q[1],
        p[3] * q[1] - p[0] * q[2] + p[1] * q[3] + p[2] * q[0],
        p[3] * q[2] + p[0] * q[1] - p[1] * q[0] + p[2] * q[3],
        p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2],
    )


@inline
def normalised(q: Quaternion) -> Quaternion:
    """Return the quaternion of unit length with w ≥ 0."""
    length = 1.0 / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if q[3] < 0.0:
        length = -length
    return q[0] * length, q[1] * length, q[2] * length, q[3] * length


@inline
def from_rotation_vector(v: Vector) -> Quaternion:
    """Return the rotation by |v| [rad] about v."""
    square = dot(v, v)
    if square < SERIES_LIMIT:
        half_sinc = 0.5 - square * (1 / 48 - square * (1 / 3840 - square * (1 / 645120)))
        cosine = 1.0 - square * (1 / 8 - square * (1 / 384 - square * (1 / 46080)))
    else:
        angle = sqrt(square)
        half_sinc = sin(0.5 * angle) / angle
        cosine = cos(0.5 * angle)
    return v[0] * half_sinc, v[1] * half_sinc, v[2] * half_sinc, cosine


@inline
def turned_at(q: Quaternion, rate: Vector, interval: float) -> Quaternion:
    """Return the attitude after an interval [s] at an angular velocity [rad/s], sensor frame."""
    return multiply(q, from_rotation_vector(scale(interval, rate)))


@inline
def matrix(q: Quaternion) -> Matrix:
    """Return the rows of the rotation matrix sensor → world."""
    x, y, z, w = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
        (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
    )


@inline
def transform(rows: Matrix, v: Vector) -> Vector:
    """Return the matrix times the vector."""
    return dot(rows[0], v), dot(rows[1], v), dot(rows[2], v)


@inline
def to_sensor(rows: Matrix, v: Vector) -> Vector:
    """Return a world vector in the sensor frame; rows: sensor → world."""
    return (
        rows[0][0] * v[0] + rows[1][0] * v[1] + rows[2][0] * v[2],
        rows[0][1] * v[0] + rows[1][1] * v[1] + rows[2][1] * v[2],
        rows[0][2] * v[0] + rows[1][2] * v[1] + rows[2][2] * v[2],
    )


@inline
def apply_symmetric(c: Symmetric, v: Vector) -> Vector:
    """Return the symmetric matrix times the vector."""
    return (
        c[0] * v[0] + c[1] * v[1] + c[2] * v[2],
        c[1] * v[0] + c[3] * v[1] + c[4] * v[2],
        c[2] * v[0] + c[4] * v[1] + c[5] * v[2],
    )


@inline
def less(s: Symmetric, v: Vector, weight: float) -> Symmetric:
    """Return s − weight · v vᵀ."""
    x, y, z = weight * v[0], weight * v[1], weight * v[2]
    return (
        s[0] - x * v[0],
        s[1] - x * v[1],
        s[2] - x * v[2],
        s[3] - y * v[1],
        s[4] - y * v[2],
        s[5] - z * v[2],
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
def rotation_between(a: Vector, up: float) -> Quaternion:
    """Return the shortest rotation of the unit vector `a` onto (0, 0, up), up = ±1."""
    cosine = a[2] * up
    if cosine < -0.999999999:  # opposite: any horizontal axis will do
        return 1.0, 0.0, 0.0, 0.0
    w = sqrt(0.5 * (1.0 + cosine))
    factor = 0.5 * up / w
    return a[1] * factor, -a[0] * factor, 0.0, w


@inline
def heading_rotation(x: float, y: float, north: tuple[float, float]) -> Quaternion:
    """Return the rotation about z that turns the horizontal vector (x, y) ≠ 0 to `north`."""
    length = sqrt(x * x + y * y)
    cosine = (x * north[0] + y * north[1]) / length
    if cosine < -0.999999999:
        return 0.0, 0.0, 1.0, 0.0
    w = sqrt(0.5 * (1.0 + cosine))
    return 0.0, 0.0, 0.5 * (x * north[1] - y * north[0]) / (length * w), w


@inline
def euler_zyx(q: Quaternion) -> Vector:
    """Return roll, pitch, yaw [rad] of R = Rz(yaw) Ry(pitch) Rx(roll), as `arrays.euler_zyx`."""
    x, y, z, w = q
    sine = min(max(2.0 * (w * y - x * z), -1.0), 1.0)
    if abs(sine) > 1.0 - 1e-12:
        return 0.0, asin(sine), copysign(2.0, -sine) * atan2(x, w) + 0.0
    roll = atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    yaw = atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return roll + 0.0, asin(sine) + 0.0, yaw + 0.0


@inline
def inclination_error(up: Vector, sign: float) -> tuple[float, float]:
    """Return x, y of the rotation vector that turns `up` to the vertical: its sine, at most 1.

    `sign` is +1 for ENU, −1 for NED. Of a vector not of unit length it is so much longer.
    """
    x, y = up[1] * sign, -up[0] * sign
    if up[2] * sign < 0.0:  # beyond 90° the sine falls again; the correction must not
        length = sqrt(x * x + y * y)
        return (x / length, y / length) if length > 1e-6 else (1.0, 0.0)
    return x, y


@inline
def heading_error(m: Vector, level: float, north: tuple[float, float]) -> float:
    """Return the sine of the angle from a field, `level` its horizontal length, to `north`.

    Beyond 90° it is ±1.
    """
    sine = (m[0] * north[1] - m[1] * north[0]) / level
    if m[0] * north[0] + m[1] * north[1] < 0.0:
        return -1.0 if sine < 0.0 else 1.0
    return sine


@inline
def attitude_from_vectors(
    f: Vector, m: Vector, up: float, north: tuple[float, float]
) -> Quaternion:
    """Return the attitude at which specific force `f` ≠ 0 points up and `m` to `north`.

    Without magnetometer (NaN) or with a field along gravity the heading is that of the shortest
    rotation from the sensor's frame. `up` is +1 for ENU, −1 for NED.
    """
    q = rotation_between(scale(1.0 / sqrt(dot(f, f)), f), up)
    if isfinite(m[0]) and isfinite(m[1]) and isfinite(m[2]):
        field = transform(matrix(q), m)
        horizontal = field[0] * field[0] + field[1] * field[1]
        if horizontal > 1e-6 * dot(m, m):
            q = multiply(heading_rotation(field[0], field[1], north), q)
    return normalised(q)
