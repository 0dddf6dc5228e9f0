# SPDX-License-Identifier: Apache-2.0
"""Rest: nothing varies. The level of the angular velocity does not matter, only its change.

A thermal offset of the gyroscope must not make a resting sensor look like a moving one, or the
bias would stop being learned exactly when it is needed.
"""

from __future__ import annotations

from typing import NamedTuple

from orientation_filters.kernel import inline
from orientation_filters.quaternion import Vector, approach, dot, subtract


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
    """Running means and for how long nothing has varied."""

    angular_velocity: Vector
    linear_acceleration: Vector
    turning: float
    """Mean square deviation of angular velocity [(rad/s)²]."""
    pushing: float
    """Mean square deviation of specific force [(m/s²)²]."""
    duration: float
    """[s]"""


@inline
def start_rest(w: Vector, f: Vector) -> RestState:
    """Return the state at the first sample."""
    return RestState(w, f, 0.0, 0.0, 0.0)


@inline
def watch_rest(state: RestState, params: RestParams, w: Vector, f: Vector, dt: float) -> RestState:
    """Return the state after a sample of angular velocity [rad/s] and specific force [m/s²]."""
    gain = dt / (params.time_constant + dt)
    mean_w = approach(state.angular_velocity, w, gain)
    mean_f = approach(state.linear_acceleration, f, gain)
    turn = subtract(w, mean_w)
    push = subtract(f, mean_f)
    turning = state.turning + gain * (dot(turn, turn) - state.turning)
    pushing = state.pushing + gain * (dot(push, push) - state.pushing)
    varies = (
        turning > params.angular_velocity * params.angular_velocity
        or pushing > params.linear_acceleration * params.linear_acceleration
    )
    return RestState(mean_w, mean_f, turning, pushing, 0.0 if varies else state.duration + dt)
