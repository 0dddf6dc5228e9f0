# SPDX-License-Identifier: Apache-2.0
"""Reference magnetic field, and detection of samples that differ from it.

The field in the world frame is described by its horizontal and vertical part, which do not depend
on heading. A sample farther from the reference than `tolerance` times its norm is rejected; the
reference follows what is accepted, and a new field is taken over only after it stayed the same
long enough while the sensor turned: what turns with the sensor (a magnet on it) does not.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from orientation_filters.kernel import inline

SETTLING_TIME_S = 2.0
"""Time for which the first reference follows every sample, as the attitude still settles [s]."""
SETTLING_MEAN_TIME_S = 0.5
"""Time constant of the running mean that is the reference meanwhile [s]."""
NEWEST_WEIGHT = 3.0
"""Weight of the newest sample beside that in a plain mean: the samples taken while the field
changed are soon forgotten."""
LEAST_ADOPTION_TIME_S = 5.0
"""Least time before a new field is adopted, however short the reference has been known [s]."""
ADOPTION_FACTOR = 1.5
"""A new field is adopted after this many times the time the reference has been known, where that
is sooner than `adoption`."""

Parts = tuple[float, float]
"""Horizontal and vertical part of a field, the vertical one downward positive."""


class FieldParams(NamedTuple):
    """Tolerance and time constants of the reference."""

    tolerance: float
    """Largest distance from the reference, as a part of its norm."""
    hold: float
    """How long the field must have agreed before it is accepted again [s]."""
    tracking: float
    """Time constant with which the reference follows accepted samples [s]."""
    adoption: float
    """How long a new field must stay the same before it becomes the reference [s]; less where
    the reference itself was seen for less."""
    turning: float
    """Angular velocity above which time counts towards adoption [rad/s]."""
    smoothing: float
    """Time constant of the field's low-pass before it is compared [s]."""


class FieldState(NamedTuple):
    """Reference, candidate for a new one, and smoothed field, in the unit of the field."""

    reference: Parts
    candidate: Parts
    smoothed: Parts
    accepted_for: float
    """How long samples have agreed with the reference [s]; 0 while they do not."""
    candidate_for: float
    """How long samples have agreed with the candidate while turning [s]."""
    known_for: float
    """Since the first sample [s]."""
    agreed_for: float
    """How long samples have agreed with the reference, interruptions left out [s]."""
    adopted: bool
    """Whether the last sample made the candidate the reference."""


@inline
def no_reference() -> FieldState:
    """Return the state before any sample."""
    return _first_reference((0.0, 0.0), 0.0, 0.0)


@inline
def norm_of(state: FieldState) -> float:
    """Return the strength of the reference, unit of the field."""
    level, sunk = state.reference
    return sqrt(level * level + sunk * sunk)


@inline
def is_accepted(state: FieldState, params: FieldParams) -> bool:
    """Whether the last sample agreed with the reference, and those before it long enough."""
    return state.accepted_for >= params.hold


@inline
def update_reference(
    state: FieldState,
    params: FieldParams,
    parts: Parts,
    rate: float,
    dt: float,
    contradicts: bool,
) -> FieldState:
    """Return the state after a sample in motion of angular velocity `rate` [rad/s].

    `contradicts`: its heading is farther from the filter's than the covariance allows.
    """
    if state.reference[0] == 0.0 and state.reference[1] == 0.0:
        return _first_reference(parts, params.hold, 0.0)
    known_for = state.known_for + dt
    if known_for < SETTLING_TIME_S:
        mean = _approach(state.reference, parts, dt / min(known_for + dt, SETTLING_MEAN_TIME_S))
        return _first_reference(mean, params.hold, known_for)
    smoothed = _approach(state.smoothed, parts, dt / (params.smoothing + dt))
    reference, accepted_for = _track(state, params, smoothed, dt, contradicts)
    candidate, candidate_for = smoothed, 0.0
    if accepted_for < params.hold:
        candidate, candidate_for = _follow_candidate(state, params, smoothed, rate, dt)
    experience = max(ADOPTION_FACTOR * state.agreed_for, LEAST_ADOPTION_TIME_S)
    adopted = candidate_for > min(params.adoption, experience)
    return FieldState(
        reference=candidate if adopted else reference,
        candidate=candidate,
        smoothed=smoothed,
        accepted_for=params.hold if adopted else accepted_for,
        candidate_for=0.0 if adopted else candidate_for,
        known_for=known_for,
        agreed_for=candidate_for if adopted else state.agreed_for + min(accepted_for, dt),
        adopted=adopted,
    )


@inline
def _first_reference(parts: Parts, accepted_for: float, known_for: float) -> FieldState:
    """Return the state while the first reference settles."""
    return FieldState(
        reference=parts,
        candidate=parts,
        smoothed=parts,
        accepted_for=accepted_for,
        candidate_for=0.0,
        known_for=known_for,
        agreed_for=known_for,
        adopted=False,
    )


@inline
def _track(
    state: FieldState, params: FieldParams, smoothed: Parts, dt: float, contradicts: bool
) -> tuple[Parts, float]:
    """Return the reference, following an accepted field, and how long it has agreed."""
    if contradicts or not _distance(smoothed, state.reference) < params.tolerance:
        return state.reference, 0.0
    accepted_for = state.accepted_for + dt
    if accepted_for < params.hold:
        return state.reference, accepted_for
    return _approach(state.reference, smoothed, dt / (params.tracking + dt)), accepted_for


@inline
def _follow_candidate(
    state: FieldState, params: FieldParams, smoothed: Parts, rate: float, dt: float
) -> tuple[Parts, float]:
    """Return the candidate and how long a rejected field has agreed with it while turning."""
    if not _distance(smoothed, state.candidate) < params.tolerance:
        return smoothed, 0.0
    memory = min(params.tracking, SETTLING_MEAN_TIME_S + state.candidate_for / NEWEST_WEIGHT)
    candidate = _approach(state.candidate, smoothed, dt / (memory + dt))
    return candidate, state.candidate_for + (dt if rate > params.turning else 0.0)


@inline
def _distance(a: Parts, b: Parts) -> float:
    """Return |a − b| as a part of |b|."""
    gap = (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])
    return sqrt(gap / (b[0] * b[0] + b[1] * b[1] + 1e-30))


@inline
def _approach(a: Parts, b: Parts, gain: float) -> Parts:
    """Return a + gain · (b − a), one step of a first-order low-pass."""
    return a[0] + gain * (b[0] - a[0]), a[1] + gain * (b[1] - a[1])
