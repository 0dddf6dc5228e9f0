# SPDX-License-Identifier: Apache-2.0
"""A claim of the paper beside what these recordings say about it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

Verdict = Literal['supported', 'not', 'untestable']

VERDICT_NAMES: dict[str, str] = {
    'supported': 'supported',
    'not': 'not supported',
    'untestable': 'untestable here',
}


FALSE_ALARM_SHARE = 0.01
"""Probability that a test finds a difference where there is none, over all channels together."""


@dataclass(frozen=True)
class Claim:
    """One claim, our numbers, a verdict and its reason."""

    key: str
    claim: str
    """What the paper says, in our words, with the place."""
    ours: str
    """Our number in one sentence."""
    verdict: Verdict
    why: str = ''
    """What was tested and how; why it cannot be tested."""
    numbers: dict[str, Any] = field(default_factory=dict)


def untestable(key: str, claim: str, why: str) -> Claim:
    """Return a claim that these recordings cannot test."""
    return Claim(key=key, claim=claim, ours='–', verdict='untestable', why=why)
