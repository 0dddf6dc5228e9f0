# SPDX-License-Identifier: Apache-2.0
"""Rest: nothing varies, and neither gravity nor the field turns. The rate itself does not matter.

A thermal offset of the gyroscope must not make a resting sensor look like a moving one, or the
bias would stop being learned exactly when it is needed. A slow steady turn must not look like an
offset: it shows in the directions of specific force and field, once it has gone on long enough.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from orientation_filters.kernel import inline
from orientation_filters.rotation.scalars import Vector, absent, approach, cross, dot, subtract

TURN = 0.02
"""Angle by which gravity or field has turned where there is no rest [rad]."""
MARGIN = 1.3
"""How much farther than `TURN` a rate must have had time to turn before it is a bias."""
CHANGE = 0.004
"""By how much the mean rate may change, besides its noise, before rest starts anew [rad/s]."""
NOISE = 25.0
"""Multiple of the variance of that change from noise alone."""
HARMLESS = 0.0026
"""Rate that is a bias without proof [rad/s]."""
PATIENCE = 10.0
"""Rest after which any rate is a bias: nothing that could show a turn has [s]."""
WAVERING = 0.05
"""Part of a field that may waver, besides what the rate turns it; more is a magnet nearby."""
ZERO = (0.0, 0.0, 0.0)


class RestParams(NamedTuple):
    """When a sensor counts as resting."""

    angular_velocity: float
    """Largest rms deviation from the running mean [rad/s]."""
    linear_acceleration: float
    """Largest rms deviation from the running mean [m/s²]."""
    duration: float
    """How long nothing may vary before it counts [s]."""
    time_constant: float
    """Of the running means and mean squares [s]."""
    bias_limit: float
    """Largest rate taken for a bias [rad/s]."""


class RestState(NamedTuple):
    """Running means, what they were when rest began, and for how long nothing has varied."""

    angular_velocity: Vector
    linear_acceleration: Vector
    magnetic_field: Vector
    """Zero before the first sample."""
    turning: float
    """Mean square deviation of angular velocity [(rad/s)²]."""
    pushing: float
    """Mean square deviation of specific force [(m/s²)²]."""
    wavering: float
    """Mean square deviation of the magnetic field [T²]."""
    duration: float
    """[s]"""
    first_bias: Vector
    """What the bias was taken for [rad/s]."""
    first_rate: Vector
    first_force: Vector
    first_field: Vector


@inline
def start_rest(w: Vector, f: Vector, m: Vector) -> RestState:
    """Return the state at the first sample; a field of NaN is none."""
    field = ZERO if absent(m) else m
    return RestState(w, f, field, 0.0, 0.0, 0.0, 0.0, ZERO, w, f, field)


@inline
def watch_rest(  # noqa: PLR0913, PLR0917 (one sample's quantities)
    state: RestState,
    params: RestParams,
    w: Vector,
    f: Vector,
    m: Vector,
    has_field: bool,
    dt: float,
    since_field: float,
    bias: Vector,
) -> RestState:
    """Return the state after a sample: rad/s, m/s², T, time since the last one and field [s].

    `bias` [rad/s] is what the filter knows.
    """
    gain = dt / (params.time_constant + dt)
    mean_w = approach(state.angular_velocity, w, gain)
    mean_f = approach(state.linear_acceleration, f, gain)
    mean_m, first_m, wavering = state.magnetic_field, state.first_field, state.wavering
    if has_field:
        if dot(mean_m, mean_m) == 0.0:
            mean_m, first_m = m, m
        field_gain = since_field / (params.time_constant + since_field)
        mean_m = approach(mean_m, m, field_gain)
        waver = subtract(m, mean_m)
        wavering += field_gain * (dot(waver, waver) - wavering)
    turn = subtract(w, mean_w)
    push = subtract(f, mean_f)
    turning = state.turning + gain * (dot(turn, turn) - state.turning)
    pushing = state.pushing + gain * (dot(push, push) - state.pushing)
    change = subtract(mean_w, state.first_rate)
    field_turn = _field_turn(mean_m, first_m, mean_f)
    allowed = WAVERING + params.time_constant * sqrt(dot(mean_w, mean_w))
    if wavering > allowed * allowed * dot(mean_m, mean_m):
        field_turn = -1.0
    if (
        turning > params.angular_velocity * params.angular_velocity
        or pushing > params.linear_acceleration * params.linear_acceleration
        or dot(change, change) > CHANGE * CHANGE + NOISE * gain * turning
        or _square_turn(mean_f, state.first_force) > TURN * TURN
        or field_turn > TURN * TURN
    ):
        return RestState(
            mean_w, mean_f, mean_m, turning, pushing, wavering, 0.0, bias, mean_w, mean_f, mean_m
        )
    if field_turn < 0.0:
        first_m = mean_m
    duration = state.duration + dt
    return RestState(
        mean_w,
        mean_f,
        mean_m,
        turning,
        pushing,
        wavering,
        duration,
        state.first_bias,
        state.first_rate,
        state.first_force,
        first_m,
    )


@inline
def _square_turn(now: Vector, first: Vector) -> float:
    """Return the square of the distance between two vectors as a part of the first's length."""
    gap = subtract(now, first)
    return dot(gap, gap) / (dot(first, first) + 1e-300)


@inline
def _field_turn(now: Vector, first: Vector, force: Vector) -> float:
    """Return the square of the angle by which the field's horizontal part turned [rad²].

    Negative where it changed as no turn of the sensor changes it, in strength or dip: a magnet.
    """
    gap = subtract(now, first)
    change = dot(gap, gap)
    across, up = cross(first, force), dot(force, force)
    level = dot(across, across) / up
    if change <= TURN * TURN * level:
        return 0.0
    strength = sqrt(dot(now, now)) - sqrt(dot(first, first))
    sunk = dot(gap, force)
    magnet = strength * strength + sunk * sunk / up > 0.25 * change
    return -1.0 if magnet else change / (level + 1e-300)


@inline
def is_bias(state: RestState, params: RestParams) -> bool:
    """Whether the mean rate can be taken for the bias: as a turn it would have shown by now."""
    rested = state.duration
    if rested < params.duration or rested >= PATIENCE:
        return rested >= params.duration
    gap = subtract(state.angular_velocity, state.first_bias)
    square = dot(gap, gap)
    proven = square * rested * rested >= (MARGIN * TURN) * (MARGIN * TURN)
    return proven or square <= HARMLESS * HARMLESS
