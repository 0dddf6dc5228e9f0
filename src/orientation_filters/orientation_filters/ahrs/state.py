# SPDX-License-Identifier: Apache-2.0
"""Parameters and state of the AHRS."""

from __future__ import annotations

from typing import NamedTuple

from orientation_filters.ahrs.adaptive import AdaptiveParams, AdaptiveState, no_adaptive_state
from orientation_filters.ahrs.measurement_update import INITIAL_VARIANCES, Noise, Variances
from orientation_filters.rotation.scalars import Quaternion, Vector

GRAVITY = 9.81
MICROTESLA = 1e6
ZERO = (0.0, 0.0, 0.0)


class Params(NamedTuple):
    """Numbers the kernel needs; `presets` makes them from named parameters with units."""

    up: float
    """World z of the upward direction: +1 ENU, −1 NED."""
    north: tuple[float, float]
    """World x, y of magnetic north (unit vector)."""
    use_magnetometer: bool
    field_strength: float
    """Expected [µT]."""
    max_gap: int
    """[ns]"""
    magnetometer_timeout: int
    """[ns]"""
    noise: Noise
    adaptive: AdaptiveParams


class State(NamedTuple):
    """What one sample leaves for the next."""

    stamp: int
    """Of the last sample used [ns]; −1 before the first."""
    orientation: Quaternion
    bias: Vector
    """Of the gyroscope [rad/s], sensor frame."""
    linear_acceleration: Vector
    """Without gravity [m/s²], sensor frame."""
    magnetic_disturbance: Vector
    """Of the last update [µT], sensor frame."""
    dip: tuple[float, float]
    """Cosine and sine of the field's inclination, downward positive."""
    variances: Variances
    """Prior of the first update while `updates` is 0, else posterior of the last."""
    updates: int
    """Since the attitude was set."""
    field_stamp: int
    """Of the last magnetometer sample [ns]; −1 before the first."""
    adaptive: AdaptiveState


ADAPTIVE_STATE = ('adaptive',)
"""Fields of the state that only the adaptive filter makes use of."""


def initial_state() -> State:
    """Return the state before the first sample."""
    q = (0.0, 0.0, 0.0, 1.0)
    adaptive = no_adaptive_state()
    return State(-1, q, ZERO, ZERO, ZERO, (1.0, 0.0), INITIAL_VARIANCES, 0, -1, adaptive)
