# SPDX-License-Identifier: Apache-2.0
"""Rest detection: no signal varies and neither gravity nor field turns, whatever the mean rate.

A thermal bias of the gyroscope must not make a resting sensor look like a moving one, or the
bias would stop being learned exactly when it is needed. A slow steady turn must not look like a
bias: it shows in the directions of specific force and field, once it has gone on long enough.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from orientation_filters.kernel import inline
from orientation_filters.rotation.scalars import (
    ZERO,
    Vector,
    absent,
    approach,
    cross,
    dot,
    subtract,
)
from orientation_filters.sample_checks import CheckedSample

DETECTABLE_TURN_RAD = 0.02
"""Least angle by which gravity or field turns while the sensor moves [rad]."""
TURN_FACTOR = 1.3
"""Factor by which a turn of that rate would have exceeded `DETECTABLE_TURN_RAD`, from which the
rate is a bias."""
LARGEST_RATE_CHANGE = 0.004
"""Change of the mean rate, besides its noise, at which rest starts anew [rad/s]."""
RATE_CHANGE_NOISE_FACTOR = 25.0
"""Multiple of the noise variance that is added to `LARGEST_RATE_CHANGE`² [1]."""
SURE_BIAS_RATE = 0.0026
"""Smaller rates are a bias at once [rad/s]."""
SURE_BIAS_DURATION_S = 10.0
"""Duration of rest after which any rate is a bias, as no turn has shown [s]."""
LARGEST_FIELD_FLUCTUATION = 0.05
"""Largest relative rms fluctuation of the field beyond what the rate explains; a larger one comes
from a moving magnet."""


class RestParams(NamedTuple):
    """Limits within which a sensor counts as resting."""

    angular_velocity: float
    """Largest rms deviation from the running mean [rad/s]."""
    linear_acceleration: float
    """Largest rms deviation from the running mean [m/s²]."""
    duration: float
    """Time without variation before it counts as rest [s]."""
    time_constant: float
    """Of the running means and mean squares [s]."""
    bias_limit: float
    """Largest rate taken for a bias [rad/s]."""


class RestState(NamedTuple):
    """Running means and variances, the means when rest began, and its duration."""

    angular_velocity: Vector
    linear_acceleration: Vector
    magnetic_field: Vector
    """Zero before the first sample."""
    angular_velocity_variance: float
    """Mean square deviation [(rad/s)²]."""
    linear_acceleration_variance: float
    """Mean square deviation [(m/s²)²]."""
    magnetic_field_variance: float
    """Mean square deviation [T²]."""
    duration: float
    """[s]"""
    first_bias: Vector
    """The filter's bias when rest began [rad/s]."""
    first_rate: Vector
    first_force: Vector
    first_field: Vector


@inline
def start_rest(w: Vector, f: Vector, m: Vector) -> RestState:
    """Return the state at the first sample; a field of NaN is none."""
    field = ZERO if absent(m) else m
    return RestState(
        angular_velocity=w,
        linear_acceleration=f,
        magnetic_field=field,
        angular_velocity_variance=0.0,
        linear_acceleration_variance=0.0,
        magnetic_field_variance=0.0,
        duration=0.0,
        first_bias=ZERO,
        first_rate=w,
        first_force=f,
        first_field=field,
    )


@inline
def update_rest(
    state: RestState, params: RestParams, sample: CheckedSample, bias: Vector
) -> RestState:
    """Return the state after a sample; `bias` [rad/s] is the filter's."""
    means = _update_means(state, params, sample)
    gain = sample.interval / (params.time_constant + sample.interval)
    field_turn = _field_turn(means, params)
    if _is_moving(means, params, gain) or field_turn > DETECTABLE_TURN_RAD * DETECTABLE_TURN_RAD:
        return _restart(means, bias)
    return RestState(
        angular_velocity=means.angular_velocity,
        linear_acceleration=means.linear_acceleration,
        magnetic_field=means.magnetic_field,
        angular_velocity_variance=means.angular_velocity_variance,
        linear_acceleration_variance=means.linear_acceleration_variance,
        magnetic_field_variance=means.magnetic_field_variance,
        duration=state.duration + sample.interval,
        first_bias=state.first_bias,
        first_rate=state.first_rate,
        first_force=state.first_force,
        first_field=means.magnetic_field if field_turn < 0.0 else means.first_field,
    )


@inline
def _update_means(state: RestState, params: RestParams, sample: CheckedSample) -> RestState:
    """Return the state with running means and variances after a sample."""
    gain = sample.interval / (params.time_constant + sample.interval)
    mean_w = approach(state.angular_velocity, sample.angular_velocity, gain)
    mean_f = approach(state.linear_acceleration, sample.linear_acceleration, gain)
    mean_m, first_m = state.magnetic_field, state.first_field
    variance_m = state.magnetic_field_variance
    if sample.has_field:
        m = sample.magnetic_field
        if dot(mean_m, mean_m) == 0.0:
            mean_m, first_m = m, m
        field_gain = sample.field_interval / (params.time_constant + sample.field_interval)
        mean_m = approach(mean_m, m, field_gain)
        deviation = subtract(m, mean_m)
        variance_m += field_gain * (dot(deviation, deviation) - variance_m)
    deviation_w = subtract(sample.angular_velocity, mean_w)
    deviation_f = subtract(sample.linear_acceleration, mean_f)
    variance_w, variance_f = state.angular_velocity_variance, state.linear_acceleration_variance
    return RestState(
        angular_velocity=mean_w,
        linear_acceleration=mean_f,
        magnetic_field=mean_m,
        angular_velocity_variance=variance_w + gain * (dot(deviation_w, deviation_w) - variance_w),
        linear_acceleration_variance=variance_f
        + gain * (dot(deviation_f, deviation_f) - variance_f),
        magnetic_field_variance=variance_m,
        duration=state.duration,
        first_bias=state.first_bias,
        first_rate=state.first_rate,
        first_force=state.first_force,
        first_field=first_m,
    )


@inline
def _is_moving(state: RestState, params: RestParams, gain: float) -> bool:
    """Whether rate or force vary, the mean rate has changed, or gravity has turned."""
    variance = state.angular_velocity_variance
    change = subtract(state.angular_velocity, state.first_rate)
    fall = subtract(state.linear_acceleration, state.first_force)
    first = state.first_force
    return (
        variance > params.angular_velocity * params.angular_velocity
        or state.linear_acceleration_variance
        > params.linear_acceleration * params.linear_acceleration
        or dot(change, change)
        > LARGEST_RATE_CHANGE * LARGEST_RATE_CHANGE + RATE_CHANGE_NOISE_FACTOR * gain * variance
        or dot(fall, fall) > DETECTABLE_TURN_RAD * DETECTABLE_TURN_RAD * dot(first, first)
    )


@inline
def _field_turn(state: RestState, params: RestParams) -> float:
    """Return the square of the angle by which the field's horizontal part turned [rad²].

    Negative where no turn of the sensor explains the field's change, in strength, dip or
    fluctuation: a magnet moved.
    """
    now, first, force = state.magnetic_field, state.first_field, state.linear_acceleration
    rate = state.angular_velocity
    allowed = LARGEST_FIELD_FLUCTUATION + params.time_constant * sqrt(dot(rate, rate))
    if state.magnetic_field_variance > allowed * allowed * dot(now, now):
        return -1.0
    difference = subtract(now, first)
    change = dot(difference, difference)
    across, up = cross(first, force), dot(force, force)
    if change * up <= DETECTABLE_TURN_RAD * DETECTABLE_TURN_RAD * dot(across, across):
        return 0.0
    level = dot(across, across) / up
    strength = sqrt(dot(now, now)) - sqrt(dot(first, first))
    sunk = dot(difference, force)
    magnet = strength * strength + sunk * sunk / up > 0.25 * change
    return -1.0 if magnet else change / (level + 1e-300)


@inline
def _restart(means: RestState, bias: Vector) -> RestState:
    """Return the state in motion: rest would begin at the present means."""
    return RestState(
        angular_velocity=means.angular_velocity,
        linear_acceleration=means.linear_acceleration,
        magnetic_field=means.magnetic_field,
        angular_velocity_variance=means.angular_velocity_variance,
        linear_acceleration_variance=means.linear_acceleration_variance,
        magnetic_field_variance=means.magnetic_field_variance,
        duration=0.0,
        first_bias=bias,
        first_rate=means.angular_velocity,
        first_force=means.linear_acceleration,
        first_field=means.magnetic_field,
    )


@inline
def is_bias(state: RestState, params: RestParams) -> bool:
    """Whether the mean rate is a bias: were it a turn, gravity or field would have shown it."""
    rested = state.duration
    if rested < params.duration or rested >= SURE_BIAS_DURATION_S:
        return rested >= params.duration
    difference = subtract(state.angular_velocity, state.first_bias)
    square = dot(difference, difference)
    limit = TURN_FACTOR * DETECTABLE_TURN_RAD
    return square * rested * rested >= limit * limit or square <= SURE_BIAS_RATE * SURE_BIAS_RATE
