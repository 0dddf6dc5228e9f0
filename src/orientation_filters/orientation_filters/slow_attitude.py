# SPDX-License-Identifier: Apache-2.0
"""Error of an attitude of fixed gain, estimated by its distance from a second, slower attitude.

A fixed gain follows every acceleration and disturbed field; a covariance of assumed noises does
not show the error. Averaged over many seconds in the world frame, accelerations cancel: the second
attitude is carried by the gyroscope and turned towards means of specific force and field with long
time constants, its bias learned by integral action (Mahony, Hamel, Pflimlin, IEEE Trans. Automatic
Control 53, 2008). The running mean square of the rotation between both is the variance of the
first attitude, which is not changed.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from orientation_filters.kernel import inline
from orientation_filters.rotation.scalars import (
    IDENTITY,
    ZERO,
    Matrix,
    Quaternion,
    Vector,
    add,
    cross,
    dot,
    from_rotation_vector,
    heading_error,
    inclination_error,
    matrix,
    multiply,
    normalised,
    scale,
    subtract,
    to_sensor,
    transform,
)
from orientation_filters.sample_checks import GRAVITY, CheckedSample
from orientation_filters.step_averages.accumulation import UNKNOWN_HEADING_VARIANCE

STEP_S = 0.2
"""Interval of the second attitude's steps, over which samples are averaged [s]."""
INCLINATION_TIME_S, HEADING_TIME_S = 10.0, 40.0
"""Time constants of the means of specific force and field [s]."""
INTEGRAL_GAIN = 0.05
"""Integral gain of the bias, as a part of 1 / time constant² [1]."""
MEAN_SQUARE_TIME_S = 10.0
"""Time constant of the mean square of the distance; bias learning begins after twice that [s]."""
START_VARIANCES = (0.04, 0.16)
"""Variances of inclination and heading from one sample, accelerated by up to 2 m/s² [rad²]."""
START_TIME_S = 0.3
"""Time that the start variances weigh in the mean square [s]."""
NEWEST_WEIGHT = 3.0
"""Weight of the newest value beside that in a plain mean."""
VARIANCE_FACTOR = 1.3
"""Variance over the mean square of the distance: the second attitude errs, too, and a mean square
lags behind."""
Frame = tuple[float, tuple[float, float]]
"""World z of the upward direction, and world x, y of magnetic north."""


class SlowAttitude(NamedTuple):
    """Distance of the second attitude from the first, and sums since its last step."""

    apart: Quaternion
    """Rotation from the first to the second, about the world's axes."""
    bias: Vector
    """Bias of the gyroscope learned by the second attitude [rad/s], sensor frame."""
    age: float
    """Since the start, up to the last step [s]."""
    elapsed: float
    """Since the last step [s]."""
    turned: Vector
    """Rotation of the first attitude by its corrections, world [rad]."""
    force: Vector
    """Integral of specific force, world of the first [m/s]."""
    field: Vector
    """Sum of fields, world of the first [T]."""
    since_field: float
    """Between the last step with a field and the last one [s]."""
    inclination: float
    """Mean square of the distance about each horizontal axis [rad²]."""
    heading: float
    """Mean square of the distance about the vertical [rad²]."""


@inline
def start_slow() -> SlowAttitude:
    """Return the state at the start: both attitudes are that of the first sample."""
    return SlowAttitude(
        apart=IDENTITY,
        bias=ZERO,
        age=0.0,
        elapsed=0.0,
        turned=ZERO,
        force=ZERO,
        field=ZERO,
        since_field=0.0,
        inclination=START_VARIANCES[0],
        heading=START_VARIANCES[1],
    )


@inline
def follow(
    before: SlowAttitude, seen: CheckedSample, rows: Matrix, turned: Vector, frame: Frame
) -> SlowAttitude:
    """Return the state after a sample.

    `rows`: the first attitude before its correction, sensor → world; `turned`: its rotation since
    the sample before, the measured rate left out, world [rad].
    """
    force, field = before.force, before.field
    if seen.has_force:
        force = add(force, scale(seen.interval, transform(rows, seen.linear_acceleration)))
    if seen.has_field:
        field = add(field, transform(rows, seen.magnetic_field))
    state = SlowAttitude(
        apart=before.apart,
        bias=before.bias,
        age=before.age,
        elapsed=before.elapsed + seen.interval,
        turned=add(add(before.turned, turned), scale(0.5, cross(turned, before.turned))),
        force=force,
        field=field,
        since_field=before.since_field,
        inclination=before.inclination,
        heading=before.heading,
    )
    return _step(state, rows, frame) if state.elapsed >= STEP_S else state


@inline
def _step(state: SlowAttitude, rows: Matrix, frame: Frame) -> SlowAttitude:
    """Return the state with the second attitude turned towards the means since the last step."""
    dt, age, (up, north) = state.elapsed, state.age, frame
    since = state.since_field + dt
    back = from_rotation_vector(scale(-0.5, state.turned))
    middle = multiply(state.apart, back)
    to_second = matrix(middle)
    f = transform(to_second, scale(1.0 / (GRAVITY * dt), state.force))
    m = transform(to_second, state.field)
    x, y = inclination_error(f, up)
    tilt = dt / (min(INCLINATION_TIME_S, age) + dt)
    level, turn = sqrt(m[0] * m[0] + m[1] * m[1]), 0.0
    if level > 1e-3 * abs(m[2]):
        turn = since / (min(HEADING_TIME_S, age) + since) * heading_error(m, level, north)
    kept = multiply(middle, back)
    correction = (tilt * x, tilt * y, turn)
    drift = transform(to_second, transform(rows, scale(dt, state.bias)))
    apart = normalised(multiply(from_rotation_vector(subtract(correction, drift)), kept))
    bias = state.bias
    if age > 2.0 * MEAN_SQUARE_TIME_S:
        rates = (
            INTEGRAL_GAIN / INCLINATION_TIME_S * correction[0],
            INTEGRAL_GAIN / INCLINATION_TIME_S * correction[1],
            INTEGRAL_GAIN / HEADING_TIME_S * correction[2],
        )
        bias = subtract(bias, to_sensor(rows, to_sensor(to_second, rates)))
    x, y, z = _squares(apart)
    gain = dt / (min(MEAN_SQUARE_TIME_S, age / NEWEST_WEIGHT + START_TIME_S) + dt)
    return SlowAttitude(
        apart=apart,
        bias=bias,
        age=age + dt,
        elapsed=0.0,
        turned=ZERO,
        force=ZERO,
        field=ZERO,
        since_field=0.0 if dot(m, m) > 0.0 else since,
        inclination=state.inclination + gain * (0.5 * (x + y) - state.inclination),
        heading=state.heading + gain * (z - state.heading),
    )


@inline
def _squares(q: Quaternion) -> Vector:
    """Return the squares of a rotation vector's components [rad²], to 3 %.

    The square of the angle is 4 asin² s; 1 / asin² s as a series in u = s², its last coefficient
    such that half a turn is right.
    """
    u = q[0] * q[0] + q[1] * q[1] + q[2] * q[2]
    factor = 4.0 / (1.0 - u * (1 / 3 + u * (1 / 15 + u * 0.1947)))
    return factor * q[0] * q[0], factor * q[1] * q[1], factor * q[2] * q[2]


@inline
def distance_variances(state: SlowAttitude) -> tuple[float, float]:
    """Return the variances of inclination (about each horizontal axis) and heading [rad²]."""
    return VARIANCE_FACTOR * state.inclination, VARIANCE_FACTOR * state.heading


@inline
def unobserved_heading_variance(stamp: int, field_stamp: int, bias_variance: float) -> float:
    """Return the variance of the heading from the time without a magnetometer sample [rad²].

    `field_stamp` −1 [ns]: no sample yet, the heading may be anything; since the last sample a bias
    of variance `bias_variance` [(rad/s)²] may have turned it.
    """
    if stamp == field_stamp:
        return 0.0
    if field_stamp < 0:
        return UNKNOWN_HEADING_VARIANCE
    seconds = 1e-9 * (stamp - field_stamp)
    return min(bias_variance * seconds * seconds, UNKNOWN_HEADING_VARIANCE)
