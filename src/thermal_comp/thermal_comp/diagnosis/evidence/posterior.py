# SPDX-License-Identifier: Apache-2.0
"""Probabilities of what explains a sensor's residual: effects, no effect known, a lost channel."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from thermal_comp.diagnosis.evidence.common_mode import runs_in_step
from thermal_comp.diagnosis.evidence.effect_sets import (
    NOT_IN_CATALOGUE,
    UNLOGGED,
    Component,
    EffectSet,
    Names,
)
from thermal_comp.diagnosis.evidence.flaws import (
    FittedSet,
    exact_weight,
    flaws,
    free_flaw,
)
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.diagnosis.evidence.remainders import (
    Remainder,
    as_unlogged,
    own_variables,
    remainders,
)
from thermal_comp.diagnosis.evidence.set_fit import in_each_variant
from thermal_comp.linear.gaussian_evidence import log_sum

CREDIBLE_PROBABILITY = 0.95
"""Probability that the reported set of explanations holds together."""
MOST_LOG_ODDS_BEHIND = 9.0
"""ln of the odds against the best set, beyond what a flaw of that explains, from which a set is
weighed as if its equations were right."""
MOST_SETS = 4
"""Sets whose equations are given a flaw, beside those that are a part of them."""
LEAST_FOLLOWED_LOG_WEIGHT = -1.0
"""ln of the weight beside a set from which the variable of an unnamed cause is reported."""
APPROXIMATE_PROBABILITY = 0.75
"""Probability of a flaw from which a form is called approximate."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """One explanation of a sensor's residual."""

    names: tuple[str, ...]
    """Effects, sorted; () where the model lacks nothing; NOT_IN_CATALOGUE or UNLOGGED, last, where
    something else acts, alone or beside effects that are believed."""
    probability: float
    approximate: bool
    """Whether an equation is probably not the whole of what its effect does."""
    components: tuple[Component, ...]
    depends_on: str | None = None
    """What the unknown part follows, or which channel is missing."""
    unseen: str = ''
    """The one of its effects that is too small to be seen beside the others; '' for none."""


def _fitted_set(
    hypotheses: SensorHypotheses, some: EffectSet, close: Sequence[EffectSet], *, courses: bool
) -> FittedSet:
    state = hypotheses.conditioned(some.components)
    free = free_flaw(hypotheses, some, state)
    course = _common_mode(hypotheses, some) if courses else -np.inf
    return FittedSet(some, state, free, course, _variables_of_larger(some, close))


def explanations(
    hypotheses: SensorHypotheses, sets: Sequence[EffectSet]
) -> tuple[list[Explanation], float]:
    """Return the explanations of one sensor, most probable first; probabilities sum to 1.

    And ln of their evidence together, relative to that of no effect.
    """
    hypotheses.allow_unnamed()
    best = max(sets, key=lambda s: s.log_posterior)
    leader = _fitted_set(hypotheses, best, (), courses=True)
    close = _likely_with_flaw(leader, sets)[:MOST_SETS]
    # What a smaller set leaves to a further effect may be a flaw of its own equations.
    close += [s for s in sets if s not in close and _is_part_of_any(s, [best, *close])]
    fitted = [
        replace(leader, variables_of_larger=_variables_of_larger(best, close))
        if some is best
        else _fitted_set(hypotheses, some, close, courses=not some.components)
        for some in close
    ]
    weighed: list[tuple[EffectSet, list[Remainder]]] = [
        (s, [Remainder('', None, exact_weight(hypotheses, s))]) for s in sets if s not in close
    ]
    lacking = flaws(hypotheses, fitted)
    weighed += [
        (one.set, remainders(hypotheses, one, flaw))
        for one, flaw in zip(fitted, lacking, strict=True)
    ]
    twins = _as_twins(hypotheses, weighed)
    weighed = [(s, [*rest, *more]) for (s, rest), more in zip(weighed, twins, strict=True)]
    weighed = [(some, as_unlogged(hypotheses, some, rest)) for some, rest in weighed]
    total = log_sum([s.log_posterior + b.log_weight for s, rest in weighed for b in rest])
    named = [_named(some, rest, total) for some, rest in weighed if not some.guessed]
    found = _with_unseen(named, hypotheses.unseen)
    found += _unnamed(weighed, total)
    return sorted(found, key=lambda e: -e.probability), total


def _likely_with_flaw(best: FittedSet, sets: Sequence[EffectSet]) -> list[EffectSet]:
    """Return the sets that may be the likeliest once their equations have a flaw.

    A flaw of an equation takes up a smooth course, so that a set that explains less may be as
    likely with one; it cannot take up a step. Sets less likely than a subset are left out.
    """
    reach = MOST_LOG_ODDS_BEHIND + max(best.free_flaw, 0.0)
    known = {s.names: s.log_posterior for s in sets}

    behind = [(s, best.set.log_posterior - s.log_posterior) for s in sets]
    return [
        s
        for s, by in behind
        if by < MOST_LOG_ODDS_BEHIND or (by < reach and not _less_likely_than_part(s, known))
    ]


def _less_likely_than_part(some: EffectSet, known: Mapping[Names, float]) -> bool:
    """Tell whether a set is less likely than one without one of its effects."""
    parts = combinations(some.names, len(some.names) - 1) if some.names else ()
    return any(known.get(part, -np.inf) >= some.log_posterior for part in parts)


def _is_part_of_any(some: EffectSet, others: Sequence[EffectSet]) -> bool:
    """Tell whether all effects of a set are in one of the others."""
    return any(set(some.names) <= set(other.names) for other in others)


def _as_twins(
    hypotheses: SensorHypotheses, weighed: Sequence[tuple[EffectSet, list[Remainder]]]
) -> list[list[Remainder]]:
    """Return by set the weights it gains from sets with a twin of one of its effects.

    The twin stands in place of the effect or beside it. A rate and a gradient differ by where a
    thermometer sits, and their columns are right to a few per cent: what one explains better than
    the other by no more than that does not decide between them. Each variant of the effect, as a
    gradient to another thermometer, has an equal share of the odds.
    """
    named = {s.names: (s, [b for b in rest if b.kind in {'', 'flaw'}]) for s, rest in weighed}
    found: list[list[Remainder]] = []
    for some, _ in weighed:
        found.append([])
        for place, component in enumerate(some.components):
            others = [name for name in some.names if name != component.name]
            beside = [
                tuple(sorted([twin, *rest]))
                for twin in hypotheses.twins_of(component.form.effect)
                for rest in (others, some.names)
                if twin not in some.names
            ]
            known = [named[names] for names in beside if names in named]
            if not known:
                continue
            ways = in_each_variant(hypotheses, some.components, place)
            for better, parts in known:
                each = [_log_odds_of_twin(hypotheses, some, way, better) for way in ways]
                odds = log_sum(each) - float(np.log(len(each)))
                change = better.log_posterior + odds - some.log_posterior
                if len(better.components) > len(some.components):
                    change += some.log_prior - better.log_prior
                if np.isfinite(odds):
                    found[-1] += [replace(b, log_weight=b.log_weight + change) for b in parts]
    return found


def _log_odds_of_twin(
    hypotheses: SensorHypotheses,
    some: EffectSet,
    components: Sequence[Component],
    better: EffectSet,
) -> float:
    """Return ln of the odds that flaws make up for what a set with a twin explains better.

    Or for what it needs less of the thermometer's errors. −∞ where it is no better: then no flaw
    is needed.
    """
    own = hypotheses.explained(components, better.components)
    evidence = better.log_posterior - better.log_prior - some.log_posterior + some.log_prior
    by = max(better.explained - own, 2.0 * evidence)
    if by <= 0.0:
        return -np.inf
    share = float(np.sqrt(by / max(own, 1.0)))
    return hypotheses.log_odds_of_twin(components, share)


def _named(some: EffectSet, rest: Sequence[Remainder], total: float) -> Explanation:
    """Return the explanation by the effects of a set, with and without a flaw of their form."""
    exact, flawed = (
        sum(float(np.exp(some.log_posterior + b.log_weight - total)) for b in rest if b.kind == k)
        for k in ('', 'flaw')
    )
    approximate = flawed > APPROXIMATE_PROBABILITY * (exact + flawed)
    return Explanation(
        names=some.names,
        probability=exact + flawed,
        approximate=approximate,
        components=some.components,
        depends_on=None,
    )


def _with_unseen(
    named: Sequence[Explanation], unseen: Mapping[Names, Mapping[str, float]]
) -> list[Explanation]:
    """Return explanations, and beside each those by one effect more that is too small to be seen.

    `unseen`: set → effect more → odds of it against none.
    """
    found: dict[Names, Explanation] = {}
    looked_at = {one.names for one in named}
    for one in named:
        odds = {'': 1.0} | {
            name: value
            for name, value in unseen.get(one.names, {}).items()
            if tuple(sorted((*one.names, name))) not in looked_at
        }
        for more, value in odds.items():
            names = tuple(sorted((*one.names, more))) if more else one.names
            before = found[names].probability if names in found else 0.0
            share = before + one.probability * value / sum(odds.values())
            found[names] = replace(one, names=names, probability=share, unseen=more)
    return list(found.values())


def _unnamed(
    weighed: Sequence[tuple[EffectSet, Sequence[Remainder]]], total: float
) -> list[Explanation]:
    """Return the explanations by something that has no name here, alone or beside effects."""
    parts: dict[Names, list[tuple[float, EffectSet, Remainder]]] = {
        (NOT_IN_CATALOGUE,): [],
        (UNLOGGED,): [],
    }
    for some, rest in weighed:
        for b in rest:
            if b.kind in {NOT_IN_CATALOGUE, UNLOGGED}:
                share = float(np.exp(some.log_posterior + b.log_weight - total))
                parts.setdefault((*b.believed, b.kind), []).append((share, some, b))
    return [_explanation(names, some) for names, some in parts.items()]


def _explanation(names: Names, parts: Sequence[tuple[float, EffectSet, Remainder]]) -> Explanation:
    """Return the explanation by something unknown, summed over the sets it stands beside."""
    if not parts:
        return Explanation(names=names, probability=0.0, approximate=False, components=())
    followed = [
        p for p in parts if not p[2].course and p[2].log_weight > LEAST_FOLLOWED_LOG_WEIGHT
    ]
    _, some, strongest = max(followed or parts, key=lambda part: part[0])
    probability = sum(part[0] for part in parts)
    logged = tuple(c for c in some.components if not c.form.effect.guessed_channel)
    return Explanation(
        names=names,
        probability=probability,
        approximate=False,
        components=logged,
        depends_on=strongest.depends_on,
    )


def _variables_of_larger(some: EffectSet, others: Sequence[EffectSet]) -> frozenset[str]:
    """Return what one further effect of another set follows and those here do not.

    Others of its effects are here as well.
    """
    return frozenset(
        variable
        for other in others
        if len(set(other.names) - set(some.names)) == 1
        for variable in own_variables(other) - own_variables(some)
    )


def _common_mode(hypotheses: SensorHypotheses, some: EffectSet) -> float:
    """Return ln of what speaks for a course over time that the runs repeat from their start.

    One that only the axes share says nothing: slow noise may be common to them.
    """
    terms = [term for c in some.components for term in c.form.terms]
    terms.append(hypotheses.thermometer)
    return 0.5 * runs_in_step(hypotheses.design, terms)


def credible(found: Sequence[Explanation]) -> list[Explanation]:
    """Return the fewest explanations that are credible together, most probable first."""
    kept: list[Explanation] = []
    for one in found:
        kept.append(one)
        if sum(e.probability for e in kept) >= CREDIBLE_PROBABILITY:
            break
    return kept


def probability(found: Sequence[Explanation], accept: Callable[[Explanation], bool]) -> float:
    """Return the probability of all explanations that are accepted."""
    return float(sum(e.probability for e in found if accept(e)))
