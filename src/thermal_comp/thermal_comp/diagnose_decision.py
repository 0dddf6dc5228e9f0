# SPDX-License-Identifier: Apache-2.0
"""From what explains a residual to what is said about it: named, unexplained or unlogged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from thermal_comp.conditions import Sensor
from thermal_comp.diagnose_judges import Judge
from thermal_comp.diagnose_search import RICHER, Rated, Search

JUDGED = 20.0
"""Evidence from which a judge's dependence counts."""
FORM_SHARE = 0.02
"""Share of the χ² gain that may be left to judges without doubting the names."""
DOMINANT = 0.95
"""An effect that explains this share alone keeps its name; the rest is its form."""
SECOND = 0.02
"""A second effect below this share of the first one's gain belongs to the first one's form."""
RIVAL_EVIDENCE = 10.0
RIVAL_SHARE = 0.98
"""Rivals: within this evidence, or this share of the χ² gain."""
CHAIN = 3
"""This many families on one sensor are a sign of something else."""
ADEQUATE = 0.9
"""Share of what can be explained from which one variable's judge counts as the law."""
CHANNELS_OF: dict[Sensor, tuple[str, ...]] = {
    'accelerometer': ('supply_voltage', 'vibration', 'humidity'),
    'gyroscope': ('supply_voltage', 'vibration', 'humidity'),
    'magnetometer': ('heater', 'compressor', 'supply_voltage'),
}
"""Channels that can act on each sensor."""


@dataclass(frozen=True)
class Named:
    """An effect that is named, with its rivals."""

    rated: Rated
    rivals: tuple[tuple[str, float], ...]
    """Names and shares of the gain, best first."""
    ambiguous_with: tuple[str, ...]
    approximate: bool = False
    """True where its form leaves more than noise."""


@dataclass(frozen=True)
class Outcome:
    """What is said about one sensor."""

    kind: Literal['complete', 'named', 'unexplained', 'unlogged']
    named: tuple[Named, ...] = ()
    depends_on: str | None = None
    evidence: float = 0.0
    tried: tuple[str, ...] = ()
    """Effects that together came closest where none is named."""


@dataclass(frozen=True)
class _Left:
    judge: Judge
    evidence: float
    gain: float
    """χ² gain beyond what noise gives as many columns."""


def decide(search: Search, judges: Sequence[Judge], missing: Sequence[str]) -> Outcome:
    """Return what is said about the sensor; `missing` are channels no run has logged."""
    found = search.run()
    left = _strongest(search, judges, found)
    if not found:
        if left is None:
            return Outcome('complete')
        return _without_name(search, judges, missing, found)
    total = search.total([r.form for r in found])[1] + (left.gain if left else 0.0)
    first = _alone(search, found)
    if first.gain >= DOMINANT * total:
        others = [r for r in found if r.form is not first.form and r.gain > SECOND * first.gain]
        if not others:
            approximate = len(found) > 1 or left is not None
            return Outcome('named', (_named(search, [first], first, approximate=approximate),))
    names = {r.name for r in found}
    fits = left is None or left.gain < FORM_SHARE * total
    relevant = [c for c in CHANNELS_OF[search.bank.sensor] if c in missing and c in LOGGED]
    if fits and len(names) < CHAIN and not (relevant and len(names) > 1):
        return Outcome('named', tuple(_named(search, found, r) for r in found))
    return _without_name(search, judges, missing, found)


LOGGED = ('heater', 'compressor', 'supply_voltage')
"""Channels whose absence alone makes several effects at once suspicious."""


def _alone(search: Search, found: Sequence[Rated]) -> Rated:
    """Return the effect found that explains most by itself."""
    rated = [search.rate([], r.form) for r in found]
    return max(rated, key=lambda r: r.gain)


def _strongest(search: Search, judges: Sequence[Judge], found: Sequence[Rated]) -> _Left | None:
    """Return the judge that explains most of what the effects leave, if it counts."""
    terms = [term for r in found for term in r.form.terms]
    before = search.bank.solve(terms)
    best: _Left | None = None
    for judge in judges:
        gain, rank = search.bank.solve([*terms, judge.term])
        gain, rank = gain - before[0], rank - before[1]
        evidence = gain - rank * search.price
        if evidence > JUDGED and (best is None or evidence > best.evidence):
            best = _Left(judge, evidence, gain - rank)
    return best


def _named(
    search: Search, found: Sequence[Rated], rated: Rated, *, approximate: bool = False
) -> Named:
    others = [r.form for r in found if r.form is not rated.form]
    ranking = [r for r in search.ranking(others) if r.name != rated.name]
    rivals = [(r.name, r.gain / rated.gain) for r in ranking[:4] if r.gain > 0.0]
    close = []
    for rival in ranking:
        near = rival.evidence > rated.evidence - RIVAL_EVIDENCE
        alike = rival.gain > RIVAL_SHARE * rated.gain and rival.evidence > 0.0
        richer = rival.name in RICHER.get(rated.name, ())
        if (near or alike) and not (richer and rival.evidence < rated.evidence + RIVAL_EVIDENCE):
            close.append(rival.name)
    return Named(rated, tuple(rivals), tuple(close[:2]), approximate)


def _without_name(
    search: Search, judges: Sequence[Judge], missing: Sequence[str], found: Sequence[Rated]
) -> Outcome:
    """Say on which variable the residual depends, or which channel is suspected."""
    bank = search.bank
    rated = []
    for judge in judges:
        gain, rank = bank.solve([judge.term])
        rated.append((gain - rank * search.price, gain - rank, judge))
    evidence, gain, judge = max(rated, key=lambda item: item[0])
    terms = [term for r in found for term in r.form.terms]
    every, rank = bank.solve([*terms, *(j.term for j in judges)])
    tried = tuple(dict.fromkeys(r.name for r in found))
    relevant = [c for c in CHANNELS_OF[bank.sensor] if c in missing]
    suspects = [c for c in relevant if c in LOGGED]
    if bank.sensor != 'magnetometer' and judge.depends_on in {'compressor', 'heater'}:
        if 'vibration' in missing:
            return Outcome('unlogged', (), 'vibration', evidence, tried)
        return Outcome('unexplained', (), judge.depends_on, evidence, tried)
    adequate = gain >= ADEQUATE * (every - rank)
    if suspects and not (adequate and judge.depends_on in _OWN):
        name = suspects[0].removesuffix('_voltage') if len(suspects) == 1 else 'chamber'
        return Outcome('unlogged', (), name, evidence, tried)
    if relevant and not adequate and judge.depends_on in {'phase', 'time', 'cycle'}:
        return Outcome('unlogged', (), 'chamber', evidence, tried)
    return Outcome('unexplained', (), judge.depends_on, evidence, tried)


_OWN = ('temperature', 'branch', 'time', 'orientation', 'heater', 'compressor', 'supply', 'cycle')
"""Variables that no channel of the chamber stands for."""
