# SPDX-License-Identifier: Apache-2.0
"""What the complementary filter is told and what it remembers."""

from __future__ import annotations

from typing import NamedTuple

from orientation_filters.magnetic_reference import FieldParams, FieldState, no_reference
from orientation_filters.quaternion import Quaternion, Vector
from orientation_filters.rest import RestParams, RestState, start_rest


class Params(NamedTuple):
    """Numbers the kernel needs; `parameters` makes them from named ones with units."""

    up: float
    """World z of the upward direction: +1 ENU, −1 NED."""
    north: tuple[float, float]
    """World x, y of magnetic north (unit vector)."""
    use_magnetometer: bool
    inclination_rate: float
    """2π × cut-off of the accelerometer's correction [rad/s]."""
    heading_rate: float
    """2π × cut-off of the magnetometer's correction [rad/s]."""
    max_gap: int
    """[ns]"""
    magnetometer_timeout: int
    """[ns]"""
    angle_random_walk: float
    """[rad/√s]"""
    bias_sigma: float
    """Gyroscope bias left over, standard deviation [rad/s]."""
    inclination_sigma: float
    """Error of one specific force as a vertical [rad]."""
    heading_sigma: float
    """Error of one magnetic field as a heading [rad]."""
    adaptive: bool
    learn_bias: bool
    start_time: float
    """Time over which the gain falls from 1 to the cut-off's, in 1 / rate."""
    bias_rate: float
    """Integral gain in motion, as a part of rate² [1]."""
    rest_bias_time: float
    """Time constant of bias learning at rest [s]."""
    rest: RestParams
    field: FieldParams


class State(NamedTuple):
    """What one sample leaves for the next."""

    stamp: int
    """Of the last sample used [ns]; −1 before the first."""
    orientation: Quaternion
    """Of nearly unit length; `orientation` gives it exactly."""
    bias: Vector
    """Of the gyroscope [rad/s], sensor frame."""
    variance: tuple[float, float]
    """Of inclination and heading from noise [rad²]."""
    lag: tuple[float, float]
    """Error of inclination and heading from a bias of one standard deviation [rad]."""
    age: float
    """Since the attitude was set [s]."""
    field_stamp: int
    """Of the last magnetometer sample [ns]; −1 before the first."""
    rest: RestState
    field: FieldState


ADAPTIVE_STATE = ('bias', 'rest', 'field')
"""Fields of the state that the filter makes no use of where it neither adapts nor learns."""


def initial_state() -> State:
    """Return the state before the first sample."""
    zero = (0.0, 0.0, 0.0)
    start = (0.0, 0.0, 0.0, 1.0)
    rest = start_rest(zero, zero, zero)
    return State(-1, start, zero, (0.0, 0.0), (0.0, 0.0), 0.0, -1, rest, no_reference())
