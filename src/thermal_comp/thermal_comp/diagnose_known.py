# SPDX-License-Identifier: Apache-2.0
"""What a richer effect has to gain before it is more than the form of one that is known."""

from __future__ import annotations

from collections.abc import Sequence

from thermal_comp.conditions import Sensor
from thermal_comp.diagnose_bank import ColumnBank, ColumnSource
from thermal_comp.diagnose_search import FORM_SHARE, SIMPLER
from thermal_comp.effects.effect import Effect
from thermal_comp.model import NoiseModel

ONCE_NAMED = {('thermal_gradient', 'temperature_rate'): FORM_SHARE}
"""Pairs that need more than SIMPLER says once the second is known: its flaw looks alike."""


def least_gains(
    source: ColumnSource, sensor: Sensor, noise: NoiseModel, known: Sequence[Effect]
) -> dict[str, float]:
    """Return by effect the χ² gain that a flaw in the form of a known effect may leave to it."""
    names = {effect.name for effect in known}
    pairs = {pair: share for pair, share in {**SIMPLER, **ONCE_NAMED}.items() if pair[1] in names}
    if not pairs:
        return {}
    simpler = {name for _, name in pairs}
    bank = ColumnBank(source, sensor, noise, [e for e in known if e.name not in simpler])
    gains = {e.name: bank.solve([bank.term(e)])[0] for e in known if e.name in simpler}
    least: dict[str, float] = {}
    for (richer, name), share in pairs.items():
        least[richer] = max(least.get(richer, 0.0), share * gains[name])
    return least
