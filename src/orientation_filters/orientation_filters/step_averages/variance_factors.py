# SPDX-License-Identifier: Apache-2.0
"""Variance factors: variance of the errors over that claimed from the assumed noises.

The assumed noises are the same for every device and motion; innovations show the actual ones. For
one angle let q and r be the true noises of gyroscope and measurement, q₀ and r₀ the assumed ones.
The error of a first-order filter of any gain then has (q/q₀ + r/r₀)/2 times the variance that the
filter claims, and so has the low-pass of its innovations by the same gain: the mean square of the
innovations gives the factor (a posteriori variance of unit weight; of innovations: Mehra, IEEE
Trans. Automatic Control 15, 1970). At rest and in motion the noises differ, and so do the factors.

Innovations do not show sensor errors that last longer than the filter's time constants. Those show
in parts of the measurement that the filter does not use: the vertical part of specific force,
strength and dip of the field. The used parts are taken to be as wrong.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from orientation_filters.kernel import inline
from orientation_filters.rotation.scalars import Symmetric

START_TIME_S = 3.0
"""Time from which innovations are used: the assumed initial errors no longer count then [s]."""
PRIOR_WEIGHT = 0.1
"""Number of independent values that the prior factor 1 weighs."""
NEWEST_WEIGHT = 3.0
"""Weight of the newest value beside that in a plain mean: value n of a mean weighs with n², so
that innovations of the start, where attitude and bias are still wrong, are forgotten."""
AVERAGED_VALUES = 60.0
"""Number of independent values that a factor is the mean over."""
LONGEST_AVERAGE_S = 60.0
"""Longest time of that mean [s]."""
FORCE_TIME_S, FIELD_TIME_S = 10.0, 2.0
"""Time constants of the low-passes that leave the persistent part of the sensors' errors [s]."""
PERSISTENT_POWER_TIME_S = 60.0
"""Time constant of the mean square of persistent errors [s]."""
ACROSS_GRAVITY_POWER = 4.0
"""Power of an accelerometer's error across gravity over that along it: calibrated by the length of
gravity, it keeps the misalignment of its axes (measured on BROAD)."""

Pair = tuple[float, float]


class Observed(NamedTuple):
    """Means over the innovations at rest or in motion."""

    factor: float
    """Variance of the errors over that claimed."""
    unused: float
    """Variance of the unused parts after the filter's low-pass [rad²]."""
    weight: float
    """Number of independent values in both."""


class AngleFactor(NamedTuple):
    """Variance factor of one angle, or of two with the same variance."""

    age: float
    """Since the first measurement, or the last change of its reference [s]."""
    innovation: Pair
    """After the filter's low-pass [rad]."""
    expected: float
    """Claimed variance of that [rad²]."""
    unused: Pair
    """Errors in parts of the measurement that the filter does not use, after that low-pass."""
    bridged: float
    """Variance that remains of gaps in the angular velocity [rad²]; it is not scaled."""
    rest: Observed
    motion: Observed


class PersistentError(NamedTuple):
    """Errors in unused parts of a measurement, as angles, and their persistent power."""

    age: float
    """Since the first measurement [s]."""
    last: Pair
    """Of the last step [rad]."""
    low: Pair
    """After a low-pass [rad]."""
    power: float
    """Mean square of that [rad²]."""
    white: float
    """Part of it that white noise of the steps explains [rad²]."""


class VarianceFactors(NamedTuple):
    """Variance factors of both angles, and persistent errors of the sensors."""

    inclination: AngleFactor
    heading: AngleFactor
    force: PersistentError
    field: PersistentError
    rests: bool
    """Whether the last step was one at rest."""


@inline
def no_factors() -> VarianceFactors:
    """Return the state before any innovation."""
    nothing = Observed(factor=1.0, unused=0.0, weight=0.0)
    angle = AngleFactor(
        age=0.0,
        innovation=(0.0, 0.0),
        expected=0.0,
        unused=(0.0, 0.0),
        bridged=0.0,
        rest=nothing,
        motion=nothing,
    )
    error = no_error()
    return VarianceFactors(inclination=angle, heading=angle, force=error, field=error, rests=False)


@inline
def no_error() -> PersistentError:
    """Return the state before any measurement."""
    return PersistentError(age=0.0, last=(0.0, 0.0), low=(0.0, 0.0), power=0.0, white=0.0)


@inline
def add_bridged(before: AngleFactor, bridged: float) -> AngleFactor:
    """Return the state after a step in which gaps of the gyroscope added a variance [rad²]."""
    return AngleFactor(
        age=before.age,
        innovation=before.innovation,
        expected=before.expected,
        unused=before.unused,
        bridged=before.bridged + bridged,
        rest=before.rest,
        motion=before.motion,
    )


@inline
def started_anew(before: AngleFactor) -> AngleFactor:
    """Return the state after the reference of an angle has changed."""
    return AngleFactor(
        age=0.0,
        innovation=(0.0, 0.0),
        expected=0.0,
        unused=(0.0, 0.0),
        bridged=before.bridged,
        rest=before.rest,
        motion=before.motion,
    )


@inline
def observe_angle(
    before: AngleFactor,
    innovation: Pair,
    unused: Pair,
    variance: float,
    noise: float,
    dt: float,
    delay: float,
    rests: bool,
) -> AngleFactor:
    """Return the state after a measurement [rad], `dt` [s] after the one before.

    `variance`, `noise`: of the angle before it and of the measurement [rad²]; `delay`: time
    constant of a low-pass that its white noise went through before [s]. The mean square of a pair
    is the sum of its squares: of two angles each is divided by √2.
    """
    gain = variance / (variance + noise)
    keep = 1.0 - gain
    seen = gain if before.age > START_TIME_S else 0.0
    innovation = _low_pass(before.innovation, innovation, seen)
    unused = _low_pass(before.unused, unused, seen)
    expected = keep * keep * before.expected + seen * variance
    rest, motion = before.rest, before.motion
    if seen > 0.0:
        ratio = _delayed(gain * delay / dt, rests) * _square(innovation) / expected
        power = _square(unused)
        if rests:
            rest = _take(rest, ratio, power, gain, dt)
        else:
            motion = _take(motion, ratio, power, gain, dt)
    return AngleFactor(
        age=before.age + dt,
        innovation=innovation,
        expected=expected,
        unused=unused,
        bridged=keep * keep * before.bridged,
        rest=rest,
        motion=motion,
    )


@inline
def _delayed(k: float, rests: bool) -> float:
    """Return how much larger the error is where a low-pass delays the measurement.

    k: time constant of the low-pass before the filter, over the filter's own; the ratio is that
    of the error's mean square to twice that of the low-passed innovation, from their spectra. For
    the gyroscope's noise, w (1 + k + i x k) / ((1 + i x) (1 + i x k)) and
    w / ((1 + i x)² (1 + i x k)): all there is at rest. For the measurement's,
    w / ((1 + i x) (1 + i x k)) and w i x / ((1 + i x)² (1 + i x k)): 1 + k. In motion both have
    half of the error, as they have in a filter whose noises are true.
    """
    square = 1.0 + 3.0 * k + k * k
    if rests:
        return (1.0 + k) * square / (1.0 + 2.0 * k)
    return 2.0 * (1.0 + k) * square / (2.0 + 5.0 * k + k * k)


@inline
def _take(before: Observed, ratio: float, power: float, gain: float, dt: float) -> Observed:
    """Return the means with one more value; 1 / gain values in a row count as one independent."""
    shortest = dt / LONGEST_AVERAGE_S
    newest = NEWEST_WEIGHT * gain
    by_ratio = max(newest / (PRIOR_WEIGHT + before.weight + newest), shortest)
    by_power = max(newest / (before.weight + newest), shortest)
    return Observed(
        factor=before.factor + by_ratio * (ratio - before.factor),
        unused=before.unused + by_power * (power - before.unused),
        weight=min(before.weight + gain, AVERAGED_VALUES),
    )


@inline
def observe_error(
    before: PersistentError, error: Pair, dt: float, time_constant: float
) -> PersistentError:
    """Return the state after a step with an error [rad] in the unused parts."""
    age = before.age + dt
    if age < time_constant:
        return PersistentError(age=age, last=error, low=error, power=0.0, white=0.0)
    low = _low_pass(before.low, error, dt / (time_constant + dt))
    change = error[0] - before.last[0], error[1] - before.last[1]
    white = 0.5 * _square(change) * dt / (2.0 * time_constant + dt)
    gain = dt / min((age - time_constant) / NEWEST_WEIGHT + dt, PERSISTENT_POWER_TIME_S)
    return PersistentError(
        age=age,
        last=error,
        low=low,
        power=before.power + gain * (_square(low) - before.power),
        white=before.white + gain * (white - before.white),
    )


@inline
def scaled(c: Symmetric, factors: VarianceFactors) -> Symmetric:
    """Return a covariance about the world's axes [rad²], scaled, with persistent errors added.

    The inclination's is at least the power of the unused vertical part.
    """
    tilt, turn = factors.inclination.motion, factors.heading.motion
    if factors.rests:
        tilt, turn = factors.inclination.rest, factors.heading.rest
    t, h = tilt.factor, turn.factor
    both = sqrt(t * h)
    more = (
        max(tilt.unused - 0.5 * t * (c[0] + c[3]), 0.0)
        + ACROSS_GRAVITY_POWER * factors.force.power
    )
    more += max(1.0 - t, 0.0) * factors.inclination.bridged
    turned = max(factors.field.power - factors.field.white, 0.0)
    turned += max(1.0 - h, 0.0) * factors.heading.bridged
    return (
        t * c[0] + more,
        t * c[1],
        both * c[2],
        t * c[3] + more,
        both * c[4],
        h * c[5] + turned,
    )


@inline
def _low_pass(before: Pair, now: Pair, gain: float) -> Pair:
    """Return before + gain · (now − before)."""
    return before[0] + gain * (now[0] - before[0]), before[1] + gain * (now[1] - before[1])


@inline
def _square(pair: Pair) -> float:
    """Return the sum of the squares."""
    return pair[0] * pair[0] + pair[1] * pair[1]
