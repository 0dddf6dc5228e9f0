# SPDX-License-Identifier: Apache-2.0
"""One line per claim: what was measured beside its limit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Verdict:
    """A claim, what was measured, and what it may be at most (or at least)."""

    claim: str
    measured: float
    limit: float
    unit: str = ''
    at_least: bool = False

    @property
    def holds(self) -> bool:
        """Whether the claim holds; a value that is no number never does."""
        if self.at_least:
            return self.measured >= self.limit
        return self.measured <= self.limit

    def __str__(self) -> str:
        bound = 'at least' if self.at_least else 'at most'
        unit = f' {self.unit}' if self.unit else ''
        mark = 'met    ' if self.holds else 'NOT MET'
        return f'{mark} {self.claim}: {self.measured:.4g}{unit} ({bound} {self.limit:g}{unit})'


def judge(verdicts: Iterable[Verdict]) -> list[str]:
    """Print every verdict; return the lines of those that do not hold."""
    failed = []
    print()
    for verdict in verdicts:
        print(verdict, flush=True)
        if not verdict.holds:
            failed.append(str(verdict))
    return failed
