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

SETTLING = 2.0
"""How long the first reference follows whatever there is: the attitude settles, too [s]."""
SETTLED = 0.5
"""Time over which it is a mean then [s]."""


class FieldParams(NamedTuple):
    """What is accepted, and how fast the reference follows."""

    tolerance: float
    """Largest distance from the reference, as a part of its norm."""
    hold: float
    """How long the field must have been right before it is accepted again [s]."""
    tracking: float
    """Time constant with which the reference follows accepted samples [s]."""
    adoption: float
    """How long a new field must stay the same before it becomes the reference [s]."""
    turning: float
    """Angular velocity above which time counts towards adoption [rad/s]."""
    smoothing: float
    """Time constant of the field's low-pass before it is judged [s]."""


class FieldState(NamedTuple):
    """Reference, candidate and smoothed field: (horizontal, vertical) each, unit of the field."""

    reference: tuple[float, float]
    candidate: tuple[float, float]
    smoothed: tuple[float, float]
    accepted_for: float
    """How long samples have agreed with the reference [s]; 0 while they do not."""
    candidate_for: float
    """How long samples have agreed with the candidate while turning [s]."""
    known_for: float
    """Since the first sample [s]."""
    adopted: bool
    """Whether the last sample made the candidate the reference."""


@inline
def no_reference() -> FieldState:
    """Return the state before any sample."""
    return FieldState((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), 0.0, 0.0, 0.0, False)


@inline
def norm_of(state: FieldState) -> float:
    """Return the strength of the reference, unit of the field."""
    level, sunk = state.reference
    return sqrt(level * level + sunk * sunk)


@inline
def _distance(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Return |a − b| as a part of |b|."""
    gap = (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])
    return sqrt(gap / (b[0] * b[0] + b[1] * b[1] + 1e-30))


@inline
def _follow(a: tuple[float, float], b: tuple[float, float], gain: float) -> tuple[float, float]:
    return a[0] + gain * (b[0] - a[0]), a[1] + gain * (b[1] - a[1])


@inline
def judge_field(
    state: FieldState, params: FieldParams, parts: tuple[float, float], rate: float, dt: float
) -> FieldState:
    """Return the state after a sample `parts` = (horizontal, vertical) at angular rate [rad/s].

    The sample is accepted where `accepted_for` has reached `params.hold`.
    """
    if state.reference[0] == 0.0 and state.reference[1] == 0.0:
        return FieldState(parts, parts, parts, params.hold, 0.0, 0.0, False)
    known_for = state.known_for + dt
    if known_for < SETTLING:
        mean = _follow(state.reference, parts, dt / min(known_for + dt, SETTLED))
        return FieldState(mean, mean, mean, params.hold, 0.0, known_for, False)
    smoothed = _follow(state.smoothed, parts, dt / (params.smoothing + dt))
    reference = state.reference
    if _distance(smoothed, reference) < params.tolerance:
        accepted_for = state.accepted_for + dt
        if accepted_for >= params.hold:
            reference = _follow(reference, smoothed, dt / (params.tracking + dt))
    else:
        accepted_for = 0.0
    accepted = accepted_for >= params.hold
    candidate = state.candidate
    candidate_for = 0.0
    if not accepted and _distance(smoothed, candidate) < params.tolerance:
        candidate = _follow(candidate, smoothed, dt / (params.tracking + dt))
        candidate_for = state.candidate_for + (dt if rate > params.turning else 0.0)
    else:
        candidate = smoothed
    if candidate_for > params.adoption:
        return FieldState(candidate, candidate, smoothed, params.hold, 0.0, known_for, True)
    return FieldState(
        reference, candidate, smoothed, accepted_for, candidate_for, known_for, False
    )
