# SPDX-License-Identifier: Apache-2.0
"""From what explains a residual to what is said about it: named, unexplained or unlogged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from thermal_comp.conditions import Sensor
from thermal_comp.diagnose_coherence import coherence_evidence
from thermal_comp.diagnose_judges import Judge
from thermal_comp.diagnose_search import ENRICHMENT, RICHER, Rated, Search

JUDGED = 20.0
"""Evidence from which a judge's dependence counts."""
FORM_SHARE = 0.02
"""Share of the χ² gain that may be left to judges without doubting the names."""
DOMINANT = 0.95
"""Effects that explain this share together keep their names; the rest is their form."""
SECOND = 0.03
"""An effect below this share of the strongest one's gain may be part of that one's form."""
RIVAL_EVIDENCE = 10.0
RIVAL_SHARE = 0.98
"""Rivals: within this evidence, or this share of the χ² gain."""
CHEAPLY_ENRICHED = ('thermal_lag',)
"""Effects whose richer form is a rival well below the full price of its parameters."""
CHAIN = 3
"""This many families on one sensor are a sign of something else."""
COHERENT = 30.0
"""Evidence from which a common course of the axes counts."""
GROUPS = (
    frozenset(
        {
            'bias_temperature_curvature',
            'thermal_lag',
            'thermal_lag_two_stage',
            'temperature_rate',
            'thermal_gradient',
            'thermal_hysteresis',
            'icing',
            'humidity',
        }
    ),
    frozenset(
        {
            'scale_factor_temperature',
            'misalignment_temperature',
            'g_sensitivity_temperature',
            'fixture_hard_iron',
            'fixture_tilt',
        }
    ),
    frozenset({'warm_up', 'bias_drift', 'bias_creep', 'turn_on_bias', 'bias_step'}),
)
"""Effects that can stand for a flaw in each other's form."""
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
        return _nothing_found(search, judges, missing, left)
    total = search.total([r.form for r in found])[1] + (left.gain if left else 0.0)
    major = _majors(search, found)
    share = search.total([r.form for r in major])[1] / total
    names = {r.name for r in major}
    relevant = [c for c in CHANNELS_OF[search.bank.sensor] if c in missing and c in LOGGED]
    fits = left is None or left.gain < FORM_SHARE * total or share >= DOMINANT
    alone = len(names) == 1
    doubtful = len(names) >= CHAIN or (relevant and not alone)
    if fits and share >= DOMINANT and not doubtful:
        rated = sorted(
            (search.rate([m.form for m in major], m.form) for m in major),
            key=lambda r: -r.evidence,
        )
        rough = left is not None or len(major) < len(found)
        return Outcome('named', tuple(_named(search, rated, r, approximate=rough) for r in rated))
    return _without_name(search, judges, missing, found)


def _nothing_found(
    search: Search, judges: Sequence[Judge], missing: Sequence[str], left: _Left | None
) -> Outcome:
    if left is not None:
        return _without_name(search, judges, missing, [])
    common = coherence_evidence(search.bank)
    if common > COHERENT:
        relevant = [c for c in CHANNELS_OF[search.bank.sensor] if c in missing]
        logged = [c for c in relevant if c in LOGGED]
        name = logged[0].removesuffix('_voltage') if len(logged) == 1 else 'chamber'
        return Outcome('unlogged' if relevant else 'unexplained', (), name, common)
    return Outcome('complete')


def _majors(search: Search, found: Sequence[Rated]) -> list[Rated]:
    """Return the effects that are more than a flaw in the strongest one's form."""
    alone = [search.rate([], r.form) for r in found]
    first = max(range(len(found)), key=lambda k: alone[k].gain)
    kin = next((g for g in GROUPS if found[first].name in g), frozenset())
    return [
        r
        for k, r in enumerate(found)
        if k == first or r.name not in kin or r.gain > SECOND * alone[first].gain
    ]


LOGGED = ('heater', 'compressor', 'supply_voltage')
"""Channels whose absence alone makes several effects at once suspicious."""


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
    close: list[str] = []
    for rival in ranking:
        near = rival.evidence > rated.evidence - RIVAL_EVIDENCE
        alike = rival.gain > RIVAL_SHARE * rated.gain and rival.evidence > 0.0
        if rival.name in RICHER.get(rated.name, ()):
            more = rival.rank + rival.form.free - rated.rank - rated.form.free
            cheap = rated.name in CHEAPLY_ENRICHED
            near = cheap and rival.gain - rated.gain > ENRICHMENT * max(more, 1)
            alike = False
        contained = any(rival.name in RICHER.get(name, ()) for name in close)
        if (near or alike) and not contained:
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
