# SPDX-License-Identifier: Apache-2.0
"""How long a run and its phase still take, as the profile has it: settling comes on top."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

from chamber_profile.profile import Step
from chamber_profile.sequence_types import DWELL, FINISHED, MOVE, STOP, Progress


def time_left(steps: Sequence[Step], progress: Progress, dwelt_s: float) -> tuple[float, float]:
    """Return what is left of the phase and of the run [s of the chamber].

    Before the chamber was ever moved, the run begins at the first step's target.
    """
    if progress.mode in FINISHED or progress.stage == STOP:
        return 0.0, 0.0
    here = steps[progress.step]
    parts = [_rest_of(here, progress, dwelt_s)]
    for before, step in zip(steps[progress.step :], steps[progress.step + 1 :], strict=False):
        parts.append(_move_s(step, before.target_c) + _stay_s(step))
    names = [(step.phase, step.cycle) for step in steps[progress.step :]]
    same = len(list(takewhile(lambda name: name == names[0], names)))
    return sum(parts[:same]), sum(parts)


def _rest_of(step: Step, progress: Progress, dwelt_s: float) -> float:
    at = step.target_c if progress.setpoint is None else progress.setpoint
    move = _move_s(step, at) if progress.stage == MOVE else 0.0
    spent = dwelt_s if progress.stage == DWELL else 0.0
    return move + max(_stay_s(step) - spent, 0.0)


def _move_s(step: Step, from_c: float) -> float:
    return abs(step.target_c - from_c) / step.rate_c_per_min * 60.0


def _stay_s(step: Step) -> float:
    return step.expected_s if step.kind == 'operator' else step.dwell_s
