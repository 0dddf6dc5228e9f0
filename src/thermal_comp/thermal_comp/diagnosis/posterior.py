# SPDX-License-Identifier: Apache-2.0
"""Probabilities of what explains a sensor's residual: effects, no effect known, a lost channel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.diagnosis import priors
from thermal_comp.diagnosis.common_course import coherence
from thermal_comp.diagnosis.generic_regressors import GenericRegressor
from thermal_comp.diagnosis.hypotheses import (
    NOT_IN_CATALOGUE,
    UNLOGGED,
    Component,
    EffectSet,
    SensorHypotheses,
)
from thermal_comp.linear.gaussian_evidence import CoefficientPrior, ConditionedDesign, log_sum

CREDIBLE = 0.95
"""Probability that the reported set of explanations holds together."""
WORTH_A_LOOK = 9.0
"""ln of the posterior below the best set's from which what its equations lack cannot matter."""
MOST_SETS = 4
"""Sets whose equations are given a flaw."""
THERMOMETER_SEEN = 20.0
"""Δχ² from which errors of the thermometer act, so that their equations may have a flaw."""
LEAST_WAYS = 4
"""Ways in which something without a name may act at least: one that is looked for is not all."""
APPROXIMATE = 0.75
"""Probability of a flaw from which a form is called approximate."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """One explanation of a sensor's residual."""

    names: tuple[str, ...]
    """Effects, sorted; () where the model lacks nothing; NOT_IN_CATALOGUE or UNLOGGED alone where
    something else acts: effects that would stand beside it are not believed."""
    probability: float
    approximate: bool
    """Whether an equation leaves more than noise."""
    components: tuple[Component, ...]
    depends_on: str | None = None
    """What the unknown part follows, or which channel is missing."""
    explained: float = 0.0
    """Δχ²."""


@dataclass(frozen=True)
class _Beside:
    """What acts beside a set: its kind, what it follows and ln of prior times evidence."""

    kind: str
    depends_on: str | None
    log_weight: float
    course: bool = False
    """Whether all that is known is that runs share a course over time."""


def explanations(hypotheses: SensorHypotheses, sets: Sequence[EffectSet]) -> list[Explanation]:
    """Return the explanations of one sensor, most probable first; probabilities sum to 1."""
    best = max(sets, key=lambda s: s.log_posterior)
    close = [s for s in sets if s.log_posterior > best.log_posterior - WORTH_A_LOOK][:MOST_SETS]
    # What a smaller set leaves to a further effect may be a flaw of its own equations.
    close += [s for s in sets if s not in close and set(s.names) <= set(best.names)]
    weighed: list[tuple[EffectSet, list[_Beside]]] = []
    for some in sets:
        rest = (
            _beside(hypotheses, some, sets, courses=some is best or not some.components)
            if some in close
            else [_Beside('', None, _exact_weight(hypotheses, some))]
        )
        weighed.append((some, rest))
    total = log_sum([s.log_posterior + b.log_weight for s, rest in weighed for b in rest])
    found = [_named(some, rest, total) for some, rest in weighed]
    found += [_unnamed(kind, weighed, total) for kind in (NOT_IN_CATALOGUE, UNLOGGED)]
    return sorted(found, key=lambda e: -e.probability)


def _exact_weight(hypotheses: SensorHypotheses, some: EffectSet) -> float:
    return (
        float(np.log(1.0 - priors.FORM_APPROXIMATE)) if _may_be_flawed(hypotheses, some) else 0.0
    )


def _may_be_flawed(hypotheses: SensorHypotheses, some: EffectSet) -> bool:
    """Tell whether anything is explained by equations: effects' or the thermometer's."""
    return bool(some.components) or hypotheses.explained_by_thermometer > THERMOMETER_SEEN


def _named(some: EffectSet, rest: Sequence[_Beside], total: float) -> Explanation:
    """Return the explanation by the effects of a set, with and without a flaw of their form."""
    exact, flawed = (
        sum(float(np.exp(some.log_posterior + b.log_weight - total)) for b in rest if b.kind == k)
        for k in ('', 'flaw')
    )
    approximate = flawed > APPROXIMATE * (exact + flawed)
    return Explanation(
        some.names, exact + flawed, approximate, some.components, None, some.explained
    )


def _unnamed(
    kind: str, weighed: Sequence[tuple[EffectSet, Sequence[_Beside]]], total: float
) -> Explanation:
    """Return the explanation by something that has no name here."""
    parts = [
        (float(np.exp(some.log_posterior + b.log_weight - total)), some, b)
        for some, rest in weighed
        for b in rest
        if b.kind == kind
    ]
    if not parts:
        return Explanation((kind,), 0.0, False, ())
    followed = [part for part in parts if not part[2].course and part[2].log_weight > 0.0]
    _, some, strongest = max(followed or parts, key=lambda part: part[0])
    probability = sum(part[0] for part in parts)
    return Explanation(
        (kind,), probability, False, some.components, strongest.depends_on, some.explained
    )


def _beside(
    hypotheses: SensorHypotheses, some: EffectSet, sets: Sequence[EffectSet], *, courses: bool
) -> list[_Beside]:
    """Return what may act beside the effects of a set: nothing, a flaw, something unknown.

    `courses`: a course over time that the axes share is looked for as well.
    """
    state = hypotheses.conditioned(some.components)
    found = [_Beside('', None, _exact_weight(hypotheses, some))]
    strongest = float(np.sqrt(some.explained)) if some.components else None
    if _may_be_flawed(hypotheses, some):
        found.append(_Beside('flaw', None, _flaw(hypotheses, some, sets, state)))
    amplitude = priors.amplitude_log_prior(strongest, priors.UNNAMED_RATIO_LN)
    once = priors.ANOTHER_EFFECT if some.components else 1.0 - priors.NOTHING
    if not some.components:
        once /= priors.NOTHING
    gains = _gains(hypotheses, some, state, amplitude)
    common = _common_course(hypotheses, some) if courses else []
    own = {c.removesuffix('_voltage') for one in some.components for c in one.form.effect.channels}
    measured = [gain for r, gain in gains if r.depends_on in own]
    if measured:
        gains = [(r, gain) for r, gain in gains if r.depends_on not in own]
        share = float(np.log(priors.CHANNEL_FLAWED / len(measured)))
        found.append(_Beside('flaw', None, log_sum(measured) + share))
    for kind, prior in ((NOT_IN_CATALOGUE, priors.NOT_IN_CATALOGUE), (UNLOGGED, priors.UNLOGGED)):
        mine = [(r, g) for r, g in gains if bool(r.unlogged) == (kind == UNLOGGED)]
        beside = [_Beside(kind, r.unlogged or r.depends_on, g) for r, g in mine]
        beside += [c for c in common if c.kind == kind]
        share = float(np.log(prior * once / max(len(beside), LEAST_WAYS)))
        found += [replace(b, log_weight=b.log_weight + share) for b in beside]
    return found


def _gains(
    hypotheses: SensorHypotheses,
    some: EffectSet,
    state: ConditionedDesign,
    amplitude: FloatArray,
) -> list[tuple[GenericRegressor, float]]:
    """Return by generic regressor ln of the evidence it adds; the best with another beside it."""
    regressors = hypotheses.regressors
    each = [_gain(state, r, amplitude) for r in regressors]
    gains = [gain for gain, _ in each]
    place = int(np.argmax(gains))
    if gains[place] > 0.0:
        term = regressors[place].term
        width = np.full(len(term.columns), each[place][1])
        best = CoefficientPrior(term.columns, shared=False, deviation=width)
        both = hypotheses.conditioned(some.components, best)
        others = [r for r in regressors if r is not regressors[place]]
        second = log_sum([_gain(both, r, amplitude)[0] for r in others])
        more = second + float(np.log(priors.ANOTHER_EFFECT / len(others)))
        gains[place] = float(np.logaddexp(gains[place], gains[place] + more))
    return list(zip(regressors, gains, strict=True))


def _gain(
    state: ConditionedDesign,
    regressor: GenericRegressor,
    amplitude: FloatArray,
    *,
    beside: bool = False,
) -> tuple[float, float]:
    """Return ln of the evidence a regressor adds and its best amplitude."""
    columns = np.array([regressor.term.columns])
    shared = regressor.term.shared
    evidence, _ = state.evidences(columns, priors.AMPLITUDES, shared=shared, beside=beside)
    weighted = evidence[0] + amplitude - state.log_evidence
    return log_sum(weighted), float(priors.AMPLITUDES[int(np.argmax(weighted))])


def _flaw(
    hypotheses: SensorHypotheses,
    some: EffectSet,
    sets: Sequence[EffectSet],
    state: ConditionedDesign,
) -> float:
    """Return ln of prior times evidence of what the equations of effects and thermometer lack.

    It is a share of the weakest effect: what is as large as that would be an effect as well.
    """
    weakest = float(np.sqrt(max(some.weakest, hypotheses.explained_by_thermometer)))
    form = priors.flaw_log_prior(weakest, priors.FORM_SHARE, priors.FORM_SHARE_LN)
    chance = priors.flaw_log_prior(weakest, priors.LIKENESS_SHARE, priors.LIKENESS_SHARE_LN)
    like_kin = hypotheses.additions(some, form, state, beside=True)
    by_chance = hypotheses.additions(some, chance, state, beside=True)
    effects = [c.form.effect for c in some.components]
    kin = {f.name for f in hypotheses.families if any(e.is_kin_of(f.effect()) for e in effects)}
    if not effects:
        kin = {f.name for f in hypotheses.families if f.effect.kin == 'temperature'}
    fitted = _gains_of_larger(some, sets, form)
    kindred = [
        max(a.log_gain, fitted.get(name, a.log_gain))
        for name, a in like_kin.items()
        if name in kin
    ]
    others = [a.log_gain for name, a in by_chance.items() if name not in kin]
    others += [_gain(state, r, form, beside=True)[0] for r in hypotheses.regressors]
    share = priors.LIKE_KIN if kindred else 0.0
    parts = [log_sum(others) + float(np.log((1.0 - share) / len(others)))]
    if kindred:
        parts.append(log_sum(kindred) + float(np.log(share / len(kindred))))
    return log_sum(parts) + float(np.log(priors.FORM_APPROXIMATE))


def _gains_of_larger(
    some: EffectSet, sets: Sequence[EffectSet], log_prior: FloatArray
) -> dict[str, float]:
    """Return ln of the evidence that one effect more adds where it was fitted beside the others.

    `log_prior` (s,) over AMPLITUDES is that of its amplitude, as what the others leave of it.
    """
    gains = {}
    for larger in sets:
        further = [c for c in larger.components if c.name not in some.names]
        fitted = larger.weakest > 0.0 and len(larger.components) == len(some.components) + 1
        if len(further) == 1 and fitted:
            size = float(np.log(max(np.sqrt(larger.weakest), priors.AMPLITUDES[0])))
            prior = float(np.interp(size, np.log(priors.AMPLITUDES), log_prior))
            evidence = larger.log_posterior - larger.log_prior
            gains[further[0].name] = evidence - some.log_posterior + some.log_prior + prior
    return gains


def _common_course(hypotheses: SensorHypotheses, some: EffectSet) -> list[_Beside]:
    """Return what a course over time that the runs repeat from their start speaks for.

    One that only the axes share says nothing: slow noise may be common to them.
    """
    terms = [term for c in some.components for term in c.form.terms]
    terms.append(hypotheses.thermometer)
    common = coherence(hypotheses.design, terms)
    if not np.isfinite(common.runs):
        return []
    return [_Beside(NOT_IN_CATALOGUE, 'time', 0.5 * common.runs, course=True)]


def credible(found: Sequence[Explanation]) -> list[Explanation]:
    """Return the fewest explanations that hold CREDIBLE together, most probable first."""
    kept: list[Explanation] = []
    for one in found:
        kept.append(one)
        if sum(e.probability for e in kept) >= CREDIBLE:
            break
    return kept


def probability(found: Sequence[Explanation], accept: Callable[[Explanation], bool]) -> float:
    """Return the probability of all explanations that are accepted."""
    return float(sum(e.probability for e in found if accept(e)))
