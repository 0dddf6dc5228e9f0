# SPDX-License-Identifier: Apache-2.0
"""The plainest law without physics: a line over temperature that bends at one temperature."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.diagnose_search import Search
from thermal_comp.prepared_run import PreparedRun

BENDS = 15
"""Temperatures tried at first, evenly over the range."""
HALVINGS = 2
"""How often the neighbourhood of the best one is searched more finely."""


@dataclass(frozen=True)
class Hinge:
    """The bend that explains most."""

    temperature: float
    """[°C]"""
    evidence: float
    gain: float


def best_hinge(search: Search) -> Hinge:
    """Return the bend that explains most of the sensor's residual by itself.

    One coefficient per axis and one temperature: error = a · max(0, T − T_bend). A law of two
    coefficients that explains less is not the law.
    """
    runs = search.bank.source.runs
    low = min(float(run.temperature.min()) for run in runs)
    high = max(float(run.temperature.max()) for run in runs)
    spacing = (high - low) / (BENDS + 1)
    even = [low + spacing * k for k in range(1, BENDS + 1)]
    best = max(_hinges(search, even), key=lambda h: h.evidence)
    for _ in range(HALVINGS):
        spacing *= 0.5
        beside = [best.temperature - spacing, best.temperature + spacing]
        best = max([best, *_hinges(search, beside)], key=lambda h: h.evidence)
    return best


def _hinges(search: Search, bends: Sequence[float]) -> list[Hinge]:
    terms = search.bank.generic_terms([(_bent_at(bend), False) for bend in bends])
    found = []
    for bend, term in zip(bends, terms, strict=True):
        gain, rank = search.bank.solve([term])
        found.append(Hinge(bend, gain - (rank + 1) * search.price, gain))
    return found


def _bent_at(bend: float) -> Callable[[PreparedRun], FloatArray]:
    def column(run: PreparedRun) -> FloatArray:
        return run.block_mean(np.maximum(run.conditions.temperature - bend, 0.0))[:, None]

    return column
