# SPDX-License-Identifier: Apache-2.0
"""What is said of a residual that no effect explains: the variable, or the log that is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from thermal_comp.conditions import Sensor
from thermal_comp.diagnose_bank import Term
from thermal_comp.diagnose_coherence import coherence
from thermal_comp.diagnose_hinge import best_hinge
from thermal_comp.diagnose_judges import Judge
from thermal_comp.diagnose_search import Rated, Search

JUDGED = 20.0
"""Evidence from which a judge's dependence counts."""
COHERENT = 20.0
"""Evidence from which a common course of the axes counts."""
IN_STEP = 8.0
"""Evidence from which the runs share the course, so that time is its variable."""
ADEQUATE = 0.9
"""Share of what can be explained from which one variable's judge counts as the law."""
WHOLLY = 0.95
"""The same where a channel is missing that could act: what hides it is never quite its course."""
VAGUE = 0.6
"""Share below which no variable that was logged is behind the residual."""
SIMPLER = 0.9
"""A judge of fewer columns is preferred where it explains this share of the best one's."""
PLAINLY = 0.8
"""Share of its gain a channel has to bring by itself, without products and lags, to be meant."""
CHANNELS_OF: dict[Sensor, tuple[str, ...]] = {
    'accelerometer': ('supply_voltage', 'vibration', 'humidity'),
    'gyroscope': ('supply_voltage', 'vibration', 'humidity'),
    'magnetometer': ('heater', 'compressor', 'supply_voltage'),
}
"""Channels that can act on each sensor."""
LOGGED = ('heater', 'compressor', 'supply_voltage')
"""Channels whose absence alone makes several effects at once suspicious."""
CHAMBER_FREE = ('temperature', 'branch', 'time', 'orientation', 'supply', 'cycle')
"""Variables that no channel of the chamber stands for."""
SWITCHED = ('heater', 'compressor')
"""Channels that drag others along: a supply droops, a plate shakes."""


@dataclass(frozen=True)
class Left:
    """The judge that explains most of what effects leave."""

    judge: Judge
    evidence: float
    gain: float
    """χ² gain beyond what noise gives as many columns."""


@dataclass(frozen=True)
class Dependence:
    """What is said of a residual without a name."""

    kind: Literal['unexplained', 'unlogged']
    depends_on: str
    evidence: float


def strongest_judge(
    search: Search, judges: Sequence[Judge], found: Sequence[Rated]
) -> Left | None:
    """Return the judge that explains most of what the effects leave, if it counts."""
    terms = [term for r in found for term in r.form.terms]
    before = search.bank.solve(terms)
    best: Left | None = None
    for judge in judges:
        gain, rank = search.bank.solve([*terms, judge.term])
        gain, rank = gain - before[0], rank - before[1]
        evidence = gain - rank * search.price
        if evidence > JUDGED and (best is None or evidence > best.evidence):
            best = Left(judge, evidence, gain - rank)
    return best


def common_course(
    search: Search, missing: Sequence[str], found: Sequence[Rated] = ()
) -> Dependence | None:
    """Return what the axes have in common beside the effects found; None where nothing.

    A course that all runs repeat from their start is one of time; one that every run has for
    itself is one of the supply where that was not logged, else of time as well.
    """
    common = coherence(search.bank, [term for r in found for term in r.form.terms])
    if common.evidence < COHERENT:
        return None
    suspects = [c for c in CHANNELS_OF[search.bank.sensor] if c in missing and c in LOGGED]
    if common.runs < IN_STEP and suspects:
        name = 'supply' if 'supply_voltage' in suspects else _suspect(suspects)
        return Dependence('unlogged', name, common.evidence)
    return Dependence('unexplained', 'time', common.evidence)


def dependence(
    search: Search, judges: Sequence[Judge], missing: Sequence[str], found: Sequence[Rated]
) -> Dependence:
    """Say on which variable the residual depends, or which channel is suspected."""
    bank = search.bank
    terms = [term for r in found for term in r.form.terms]
    everything, _ = explainable(search, judges, terms)
    judge, evidence, gain = _law(search, judges)
    evidence = max(evidence, search.total([r.form for r in found])[0])
    relevant = [c for c in CHANNELS_OF[bank.sensor] if c in missing]
    suspects = [c for c in relevant if c in LOGGED]
    if judge.depends_on == 'humidity' and 'humidity' in relevant:
        if best_hinge(search).evidence > evidence:
            return Dependence('unexplained', 'temperature', evidence)
        return Dependence('unlogged', 'humidity', evidence)
    adequate = gain >= (WHOLLY if suspects else ADEQUATE) * everything
    plainly = judge.depends_on in SWITCHED and _plainly(search, judge)
    if bank.sensor != 'magnetometer' and judge.depends_on in SWITCHED:
        # A compressor reaches accelerometer and gyroscope by shaking them or through the supply.
        shaken = judge.depends_on == 'compressor' and plainly
        if 'vibration' in missing and (shaken or not adequate):
            return Dependence('unlogged', 'vibration', evidence)
        if suspects:
            return Dependence('unlogged', _suspect(suspects), evidence)
        return Dependence('unexplained', judge.depends_on, evidence)
    if suspects and not (adequate and (plainly or judge.depends_on in CHAMBER_FREE)):
        return Dependence('unlogged', _suspect(suspects), evidence)
    vague = gain < VAGUE * everything
    if relevant and (vague or (not adequate and judge.depends_on in {'phase', 'time', 'cycle'})):
        return Dependence('unlogged', 'chamber', evidence)
    return Dependence('unexplained', judge.depends_on, evidence)


def _law(search: Search, judges: Sequence[Judge]) -> tuple[Judge, float, float]:
    """Return the judge that stands for the law, its evidence and its variable's χ² gain.

    The strongest one, three standard deviations of what noise gives its columns aside, may be
    flexible enough to follow another variable's law: the one of fewest columns that explains
    nearly as much is preferred. The gain beyond noise is that of the best judge of its variable.
    """
    rated = []
    for judge in judges:
        gain, rank = search.bank.solve([judge.term])
        net = gain - rank - 3.0 * float(np.sqrt(2.0 * rank))
        rated.append((net, rank, gain - rank * search.price, gain - rank, judge))
    best = max(net for net, *_ in rated)
    near = [item for item in rated if item[0] >= min(SIMPLER * best, best)]
    _, _, evidence, _, judge = min(near, key=lambda item: item[1])
    return judge, evidence, max(row[3] for row in rated if row[4].depends_on == judge.depends_on)


def explainable(
    search: Search, judges: Sequence[Judge], terms: Sequence[Term]
) -> tuple[float, float]:
    """Return the χ² gain beyond noise of the terms and all judges, and what noise spreads it."""
    gain, rank = search.bank.solve([*terms, *(judge.term for judge in judges)])
    return gain - rank, float(np.sqrt(2.0 * rank))


def _plainly(search: Search, judge: Judge) -> bool:
    """Tell whether the channel by itself, its first column, explains most of what it can."""
    alone = search.bank.solve([Term(judge.term.columns[:1])])[0]
    return alone >= PLAINLY * search.bank.solve([judge.term])[0]


def _suspect(channels: Sequence[str]) -> str:
    return channels[0].removesuffix('_voltage') if len(channels) == 1 else 'chamber'
