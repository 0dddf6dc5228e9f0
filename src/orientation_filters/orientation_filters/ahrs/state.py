# SPDX-License-Identifier: Apache-2.0
"""Parameters and state of the AHRS, the Kalman step at every sample and the adaptive one."""

from __future__ import annotations

from typing import NamedTuple

from orientation_filters.ahrs.covariance import JointCovariance, no_covariance
from orientation_filters.rotation.scalars import (
    IDENTITY,
    ZERO,
    ZERO_SYMMETRIC,
    Quaternion,
    Symmetric,
    Vector,
)
from orientation_filters.sample_checks import SampleParams
from orientation_filters.slow_attitude import SlowAttitude, start_slow
from orientation_filters.step_averages.accumulation import (
    AveragingParams,
    AveragingState,
    no_averages,
)

MICROTESLA_PER_TESLA = 1e6
"""µT per T: the documented noises are in µT²."""


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


class Params(NamedTuple):
    """Numbers the kernel needs; `AhrsParameters` names them with units."""

    up: float
    """World z of the upward direction: +1 ENU, −1 NED."""
    north: tuple[float, float]
    """World x, y of magnetic north (unit vector)."""
    field_strength: float
    """Expected [µT]."""
    learn_bias: bool
    samples: SampleParams
    noise: Noise
    adaptive: bool
    averaging: AveragingParams


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
    orientation=(6.092348e-6, 6.092348e-6, 6.092348e-6),
    bias=(7.615435e-5, 7.615435e-5, 7.615435e-5),
    acceleration=(9.62361e-3, 9.62361e-3, 9.62361e-3),
    disturbance=(0.6, 0.6, 0.6),
)
"""Prior of the first update, as the technical note has it; θ and b are then uncorrelated."""


class AdaptiveKalmanState(NamedTuple):
    """State of the adaptive step besides that of the AHRS."""

    covariance: JointCovariance
    shown: Symmetric
    """Orientation's part with the variance factors [rad²]."""
    averages: AveragingState


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
    slow: SlowAttitude
    """Second attitude, from which the error of the technical note's step is estimated."""
    updates: int
    """Since the attitude was set."""
    field_stamp: int
    """Of the last magnetometer sample [ns]; −1 before the first."""
    adaptive: AdaptiveKalmanState


ADAPTIVE_STATE = ('adaptive',)
"""Fields of the state that only the adaptive step uses."""
FIXED_STATE = ('variances', 'slow')
"""Fields of the state that only the step at every sample uses."""


def initial_state() -> State:
    """Return the state before the first sample."""
    return State(
        stamp=-1,
        orientation=IDENTITY,
        bias=ZERO,
        linear_acceleration=ZERO,
        magnetic_disturbance=ZERO,
        dip=(1.0, 0.0),
        variances=INITIAL_VARIANCES,
        slow=start_slow(),
        updates=0,
        field_stamp=-1,
        adaptive=AdaptiveKalmanState(
            covariance=no_covariance(), shown=ZERO_SYMMETRIC, averages=no_averages()
        ),
    )
