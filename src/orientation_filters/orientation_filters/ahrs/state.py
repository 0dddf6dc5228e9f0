# SPDX-License-Identifier: Apache-2.0
"""Parameters and state of the AHRS, the Kalman step at every sample and the adaptive one."""

from __future__ import annotations

from typing import NamedTuple

from orientation_filters.ahrs.covariance import JointCovariance, no_covariance
from orientation_filters.kernel import inline
from orientation_filters.magnetic_reference import FieldParams, FieldState, no_reference
from orientation_filters.rest_detection import RestParams, RestState, start_rest
from orientation_filters.rotation.scalars import IDENTITY, ZERO, Matrix, Quaternion, Vector
from orientation_filters.sample_checks import SampleParams

MICROTESLA = 1e6
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


class AdaptiveParams(NamedTuple):
    """Noises of the adaptive step, as densities: they do not depend on the sample rate."""

    enabled: bool
    interval: float
    """Between Kalman steps [s]."""
    angle_random_walk: float
    """[rad/√s]"""
    rate_error: float
    """Error of the angular velocity as a part of itself, random over a second."""
    bias_random_walk: float
    """[rad/s/√s]"""
    acceleration_floor: float
    """Density of specific force's error at rest [m/s² √s]."""
    acceleration_weight: float
    """How much of the acceleration's power counts as density [s]."""
    acceleration_memory: float
    """Time constant of the mean of that power [s]."""
    acceleration_smoothing: float
    """Time constant of specific force's low-pass in the world frame [s]."""
    heading_noise: float
    """Density of the undisturbed field's heading error [rad √s]."""
    rest_noise: float
    """Density of the resting gyroscope's error [rad/s √s]."""
    initial_inclination: float
    """Standard deviation at the start [rad]."""
    initial_heading: float
    """Standard deviation at the start [rad]."""
    initial_bias: float
    """Standard deviation at the start [rad/s]."""
    rest: RestParams
    field: FieldParams


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
    adaptive: AdaptiveParams


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


class Integrals(NamedTuple):
    """Samples added up since the last adaptive step."""

    elapsed: float
    """[s]"""
    turned: Matrix
    """Integral of the attitude's matrix over time [s]."""
    force: Vector
    """Integral of specific force, world [m/s]."""
    field: Vector
    """Sum of fields, world [T]."""
    fields: int
    """Number of fields in the sum."""
    angle: float
    """Integral of |angular velocity|² [rad²/s]."""


class AdaptiveState(NamedTuple):
    """What the adaptive step needs besides the AHRS's state."""

    covariance: JointCovariance
    integrals: Integrals
    power: float
    """Running mean of the horizontal acceleration's square, per axis [(m/s²)²]."""
    smoothed: Vector
    """Specific force after its low-pass, world [m/s²]."""
    age: float
    """Since the start, of steps with a specific force [s]."""
    rest: RestState
    reference: FieldState
    since_field: float
    """Time since the last step with a field [s]."""


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
"""Fields of the state that only the adaptive step makes use of."""


@inline
def no_integrals() -> Integrals:
    """Return the integrals right after a step."""
    return Integrals(
        elapsed=0.0, turned=(ZERO, ZERO, ZERO), force=ZERO, field=ZERO, fields=0, angle=0.0
    )


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
        updates=0,
        field_stamp=-1,
        adaptive=AdaptiveState(
            covariance=no_covariance(),
            integrals=no_integrals(),
            power=0.0,
            smoothed=ZERO,
            age=0.0,
            rest=start_rest(ZERO, ZERO, ZERO),
            reference=no_reference(),
            since_field=0.0,
        ),
    )
