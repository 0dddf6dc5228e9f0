# SPDX-License-Identifier: Apache-2.0
"""Parameters and state of the complementary filter, of fixed gain and adaptive."""

from __future__ import annotations

from typing import NamedTuple

from orientation_filters.complementary.adaptive import AdaptiveState, no_adaptation
from orientation_filters.rest_detection import RestParams, RestState, start_rest
from orientation_filters.rotation.scalars import IDENTITY, ZERO, Quaternion, Vector
from orientation_filters.sample_checks import SampleParams
from orientation_filters.slow_attitude import SlowAttitude, start_slow
from orientation_filters.step_averages.accumulation import AveragingParams


class Params(NamedTuple):
    """Numbers the kernel needs; `ComplementaryParameters` names them with units."""

    up: float
    """World z of the upward direction: +1 ENU, −1 NED."""
    north: tuple[float, float]
    """World x, y of magnetic north (unit vector)."""
    inclination_rate: float
    """2π × cut-off of the accelerometer's correction [rad/s]."""
    heading_rate: float
    """2π × cut-off of the magnetometer's correction [rad/s]."""
    bias_sigma: float
    """Gyroscope bias left over, standard deviation [rad/s]."""
    inclination_sigma: float
    """Error of specific force as a vertical that stays [rad]."""
    heading_sigma: float
    """Error of the magnetic field as a heading that stays [rad]."""
    adaptive: bool
    learn_bias: bool
    bias_rate: float
    """Integral gain in motion, as a part of rate² [1]."""
    rest_bias_time: float
    """Time constant of bias learning at rest [s]."""
    samples: SampleParams
    rest: RestParams
    averaging: AveragingParams


class State(NamedTuple):
    """What one sample leaves for the next."""

    stamp: int
    """Of the last sample used [ns]; −1 before the first."""
    orientation: Quaternion
    """Of nearly unit length; `Estimate` gives it exactly."""
    bias: Vector
    """Of the gyroscope [rad/s], sensor frame."""
    slow: SlowAttitude
    """What the error is told by, gains being fixed."""
    age: float
    """Since the attitude was set [s]."""
    field_stamp: int
    """Of the last magnetometer sample [ns]; −1 before the first."""
    rest: RestState
    disturbance: float
    """Distance of the field from the reference [T], adaptive."""
    adaptive: AdaptiveState


ADAPTIVE_STATE = ('bias', 'rest', 'disturbance', 'adaptive')
"""Fields of the state that are unused where the filter neither adapts nor learns."""
FIXED_STATE = ('slow', 'age', 'rest')
"""Fields of the state that the adaptive filter does not use."""


def initial_state() -> State:
    """Return the state before the first sample."""
    return State(
        stamp=-1,
        orientation=IDENTITY,
        bias=ZERO,
        slow=start_slow(),
        age=0.0,
        field_stamp=-1,
        rest=start_rest(ZERO, ZERO, ZERO),
        disturbance=0.0,
        adaptive=no_adaptation(),
    )
