# SPDX-License-Identifier: Apache-2.0
"""Probabilities of what explains a sensor's residual: effects, no effect known, a lost channel."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.common_mode import coherence
from thermal_comp.diagnosis.evidence.generic_regressors import GenericRegressor
from thermal_comp.diagnosis.evidence.hypotheses import (
    NOT_IN_CATALOGUE,
    UNLOGGED,
    Component,
    EffectSet,
    Names,
    SensorHypotheses,
)
from thermal_comp.linear.candidate_design import ColumnGroup
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
MOST_TOGETHER = 3
"""Flexible functions beside each other."""
LEAST_FOLLOWED = -1.0
"""ln of the weight beside a set from which what something without a name follows is said."""
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


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A set with the equations beside its effects and what a free flaw adds."""

    set: EffectSet
    state: ConditionedDesign
    free_flaw: float
    course: float
    """ln of the evidence for a course that the runs share; −∞ where none was looked for."""
    variables_of_larger: frozenset[str]
    """Variables that a further effect in a larger set follows: any law of such a variable is that
    effect's law and its flaw, so it is weighed in the larger set."""

    @property
    def course_size(self) -> float:
        """√Δχ² of that course."""
        return float(np.sqrt(2.0 * max(self.course, 0.0)))


def _fitted(
    hypotheses: SensorHypotheses, some: EffectSet, close: Sequence[EffectSet], *, courses: bool
) -> _Fitted:
    state = hypotheses.conditioned(some.components)
    free = _free_flaw(hypotheses, some, state)
    course = _common_mode(hypotheses, some) if courses else -np.inf
    return _Fitted(some, state, free, course, _variables_of_larger(some, close))


def explanations(hypotheses: SensorHypotheses, sets: Sequence[EffectSet]) -> list[Explanation]:
    """Return the explanations of one sensor, most probable first; probabilities sum to 1."""
    hypotheses.allow_unnamed()
    best = max(sets, key=lambda s: s.log_posterior)
    close = [s for s in sets if s.log_posterior > best.log_posterior - WORTH_A_LOOK][:MOST_SETS]
    # What a smaller set leaves to a further effect may be a flaw of its own equations.
    close += [s for s in sets if s not in close and set(s.names) <= set(best.names)]
    fitted = [
        _fitted(hypotheses, some, close, courses=some is best or not some.components)
        for some in close
    ]
    weighed: list[tuple[EffectSet, list[_Beside]]] = [
        (s, [_Beside('', None, _exact_weight(hypotheses, s))]) for s in sets if s not in close
    ]
    flaws = _flaws(hypotheses, fitted)
    weighed += [
        (one.set, _beside(hypotheses, one, flaw)) for one, flaw in zip(fitted, flaws, strict=True)
    ]
    twins = _as_twins(hypotheses, weighed)
    weighed = [(s, [*rest, *more]) for (s, rest), more in zip(weighed, twins, strict=True)]
    total = log_sum([s.log_posterior + b.log_weight for s, rest in weighed for b in rest])
    weighed = [(some, _unlogged(some, rest)) for some, rest in weighed]
    named = [_named(some, rest, total) for some, rest in weighed if not some.guessed]
    found = _with_unseen(named, hypotheses.unseen)
    found += [_unnamed(kind, weighed, total) for kind in (NOT_IN_CATALOGUE, UNLOGGED)]
    return sorted(found, key=lambda e: -e.probability)


def _unlogged(some: EffectSet, rest: list[_Beside]) -> list[_Beside]:
    """Return what acts beside a set, whose own weight speaks for the channel that it guesses."""
    if not some.guessed:
        return rest
    return [
        replace(b, kind=UNLOGGED, depends_on=some.guessed) if b.kind in {'', 'flaw'} else b
        for b in rest
    ]


def _as_twins(
    hypotheses: SensorHypotheses, weighed: Sequence[tuple[EffectSet, list[_Beside]]]
) -> list[list[_Beside]]:
    """Return by set the weights it gains from sets with a twin of one of its effects.

    The twin stands in place of the effect or beside it. A rate and a gradient differ by where a
    thermometer sits, and their columns are right to a few per cent: what one explains better than
    the other by no more than that does not decide between them.
    """
    named = {s.names: (s, [b for b in rest if b.kind in {'', 'flaw'}]) for s, rest in weighed}
    found: list[list[_Beside]] = []
    for some, _ in weighed:
        found.append([])
        for component in some.components:
            twin = component.form.effect.twin
            others = [name for name in some.names if name != component.name]
            for names in ([twin, *others], [twin, *some.names]):
                better, parts = named.get(tuple(sorted(names)), (some, []))
                if twin in some.names or better.explained <= some.explained:
                    continue
                share = float(np.sqrt(better.explained - some.explained))
                share /= max(_explained_by_equations(hypotheses, some), 1.0)
                change = better.log_posterior - better.log_prior + some.log_prior
                change += priors.log_odds_of_twin(share) - some.log_posterior
                found[-1] += [replace(b, log_weight=b.log_weight + change) for b in parts]
    return found


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


def _with_unseen(
    named: Sequence[Explanation], unseen: Mapping[Names, Mapping[str, float]]
) -> list[Explanation]:
    """Return explanations, and beside each those by one effect more that is too small to be seen.

    `unseen`: set → effect more → odds of it against none.
    """
    found: dict[Names, Explanation] = {}
    looked_at = {one.names for one in named}
    for one in named:
        odds: dict[Names, float] = {(): 1.0}
        for name, value in unseen.get(one.names, {}).items():
            if tuple(sorted((*one.names, name))) not in looked_at:
                odds[(name,)] = value
        for more, value in odds.items():
            names = tuple(sorted((*one.names, *more)))
            before = found[names].probability if names in found else 0.0
            share = one.probability * value / sum(odds.values())
            found[names] = replace(one, names=names, probability=before + share)
    return list(found.values())


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
    followed = [p for p in parts if not p[2].course and p[2].log_weight > LEAST_FOLLOWED]
    _, some, strongest = max(followed or parts, key=lambda part: part[0])
    probability = sum(part[0] for part in parts)
    believed = tuple(c for c in some.components if not c.form.effect.guessed_channel)
    return Explanation((kind,), probability, False, believed, strongest.depends_on, some.explained)


def _own_variables(some: EffectSet) -> set[str]:
    """Return what the effects of a set follow: channels, and 'frequency' for a spectral line."""
    effects = [one.form.effect for one in some.components]
    channels = {c.removesuffix('_voltage') for effect in effects for c in effect.channels}
    lines = [effect for effect in effects if effect.line_frequency is not None]
    return channels | ({'frequency'} if lines else set())


def _variables_of_larger(some: EffectSet, others: Sequence[EffectSet]) -> frozenset[str]:
    """Return what one effect more in another set follows and those here do not."""
    return frozenset(
        variable
        for other in others
        if len(other.names) == len(some.names) + 1 and set(other.names) >= set(some.names)
        for variable in _own_variables(other) - _own_variables(some)
    )


def _beside(hypotheses: SensorHypotheses, one: _Fitted, flaw: float) -> list[_Beside]:
    """Return what may act beside the effects of a set: nothing, a flaw, something unknown."""
    some, state = one.set, one.state
    found = [_Beside('', None, _exact_weight(hypotheses, some))]
    if _may_be_flawed(hypotheses, some):
        found.append(_Beside('flaw', None, flaw))
    strongest = float(np.sqrt(some.explained)) if some.components else None
    amplitude = priors.amplitude_log_prior(strongest, priors.UNNAMED_RATIO_LN)
    gains = _gains(hypotheses, some, state, amplitude)
    own = _own_variables(some)
    measured = [(r, gain) for r, gain in gains if r.depends_on in own]
    if measured:
        own_error = priors.flaw_log_prior(_explained_by_equations(hypotheses, some))
        # A line that comes and goes with its cause, a heater's, lacks as much as it explains.
        each = [
            gain
            if r.depends_on == 'frequency'
            else _gain(state, r.term, own_error, beside=True)[0]
            for r, gain in measured
        ]
        share = float(np.log(priors.CHANNEL_FLAWED / len(measured)))
        found.append(_Beside('flaw', None, log_sum(each) + share))
    gains = [
        (r, gain) for r, gain in gains if r.unlogged or r.depends_on not in one.variables_of_larger
    ]
    course = one.course + _at(one.course_size, amplitude)
    weight = log_sum([b.log_weight for b in found])
    found += _unknown(hypotheses, some, gains, course)
    found += _switched(hypotheses, some, weight) + _unseen_twins(hypotheses, some, weight)
    return found + _of_any_cause(some, weight)


def _unknown(
    hypotheses: SensorHypotheses,
    some: EffectSet,
    gains: Sequence[tuple[GenericRegressor, float]],
    course: float,
) -> list[_Beside]:
    """Return what speaks for a law that is not in the catalogue, and for a lost channel.

    A lost channel betrays itself by the trace it leaves in others. What follows time may be
    either, as may what follows the phase of the cycle, where a machine is likelier.
    """
    once = priors.ANOTHER_EFFECT if some.components else 1.0 - priors.NOTHING
    if not some.components:
        once /= priors.NOTHING
    lost = hypotheses.lost_over_time
    laws = [_Beside(NOT_IN_CATALOGUE, r.depends_on, g) for r, g in gains if r.may_be_law]
    laws += [_Beside(NOT_IN_CATALOGUE, 'time', course, course=True)]
    traces = [_Beside(UNLOGGED, r.unlogged, g) for r, g in gains if r.unlogged]
    either = [_Beside(UNLOGGED, r.suspect, g) for r, g in gains if r.suspect]
    either += [_Beside(UNLOGGED, lost, course, course=True)] if lost else []
    found = []
    for beside, prior, ways in (
        (laws, priors.NOT_IN_CATALOGUE, len(laws)),
        (traces, priors.UNLOGGED, len(traces)),
        (either, priors.UNLOGGED * priors.LOST_WITHOUT_TRACE, len(laws)),
    ):
        share = float(np.log(prior * once / max(ways, LEAST_WAYS)))
        found += [replace(b, log_weight=b.log_weight + share) for b in beside]
    return found


def _switched(hypotheses: SensorHypotheses, some: EffectSet, weight: float) -> list[_Beside]:
    """Return what speaks for one cause of the several steps of a set; `weight`: the set's.

    A lost channel that is switched makes as many steps as it likes, and so does a sensor whose
    bias jumps between levels by itself (random telegraph noise), which is no effect.
    """
    steps = max(Counter(some.names).values(), default=0)
    if steps < 2:
        return []
    size = len(some.names)
    once = weight + hypotheses.log_prior(size - steps + 1) - hypotheses.log_prior(size)
    jumps = priors.NOT_IN_CATALOGUE * priors.JUMPS_BY_ITSELF
    found = [_Beside(NOT_IN_CATALOGUE, 'time', once + float(np.log(jumps)))]
    if lost := hypotheses.lost_over_time:
        found.append(_Beside(UNLOGGED, lost, once + float(np.log(priors.UNLOGGED))))
    return found


def _unseen_twins(hypotheses: SensorHypotheses, some: EffectSet, weight: float) -> list[_Beside]:
    """Return what speaks for effects whose channel was not logged in place of those of a set.

    What cannot be told from an effect is as likely as the set with that one; `weight`: the set's.
    """
    twins = [c.form.effect.twin for c in some.components]
    share = weight + float(np.log(priors.UNSEEN_TWIN))
    lost = hypotheses.without_channel
    return [_Beside(UNLOGGED, lost[twin], share) for twin in twins if twin in lost]


def _of_any_cause(some: EffectSet, weight: float) -> list[_Beside]:
    """Return what speaks for another cause of an effect of a set; `weight`: the set's."""
    share = weight + float(np.log(priors.ANY_CAUSE))
    effects = [c.form.effect for c in some.components if c.form.effect.of_any_cause]
    return [
        _Beside(NOT_IN_CATALOGUE, 'time' if e.line_frequency is None else 'frequency', share)
        for e in effects
    ]


def _gains(
    hypotheses: SensorHypotheses,
    some: EffectSet,
    state: ConditionedDesign,
    amplitude: FloatArray,
) -> list[tuple[GenericRegressor, float]]:
    """Return by generic regressor ln of the evidence it adds; the best with others beside it."""
    regressors = hypotheses.regressors
    gains = _together(hypotheses, some, state, [r.term for r in regressors], amplitude)
    return list(zip(regressors, gains, strict=True))


def _together(
    hypotheses: SensorHypotheses,
    some: EffectSet,
    state: ConditionedDesign,
    terms: Sequence[ColumnGroup],
    amplitude: FloatArray,
    *,
    beside: bool = False,
    known: tuple[CoefficientPrior, ...] = (),
) -> list[float]:
    """Return ln of the evidence each flexible function adds; the best with others beside it.

    What acts rarely follows one variable alone: another may stand beside the best, and so on.
    """
    each = [_gain(state, term, amplitude, beside=beside) for term in terms]
    gains = [gain for gain, _ in each]
    place = int(np.argmax(gains))
    if gains[place] > 0.0 and len(known) + 1 < MOST_TOGETHER:
        columns, width = terms[place].columns, each[place][1]
        if beside:
            width /= np.sqrt(state.power(columns))
        best = CoefficientPrior(columns, shared=False, deviation=np.full(len(columns), width))
        with_best = (*known, best)
        after = hypotheses.conditioned(some.components, with_best)
        others = [term for term in terms if term is not terms[place]]
        further = _together(
            hypotheses, some, after, others, amplitude, beside=beside, known=with_best
        )
        more = log_sum(further) + float(np.log(priors.ANOTHER_EFFECT / len(others)))
        gains[place] = float(np.logaddexp(gains[place], gains[place] + more))
    return gains


def _gain(
    state: ConditionedDesign, term: ColumnGroup, amplitude: FloatArray, *, beside: bool = False
) -> tuple[float, float]:
    """Return ln of the evidence a flexible function adds and its best amplitude.

    `amplitude` (s,) is ln of the prior over AMPLITUDES; `beside`: of all that the function adds.
    """
    evidence, _ = state.evidences(
        np.array([term.columns]), priors.AMPLITUDES, shared=term.shared, beside=beside
    )
    weighted = evidence[0] + amplitude - state.log_evidence
    return log_sum(weighted), float(priors.AMPLITUDES[int(np.argmax(weighted))])


def _free_flaw(hypotheses: SensorHypotheses, some: EffectSet, state: ConditionedDesign) -> float:
    """Return ln of the evidence that a smooth function of all that was logged adds to a set.

    It is as large as a share of what the equations of effects and thermometer explain (Kennedy
    and O'Hagan, Bayesian Calibration of Computer Models, 2001).
    """
    size = priors.flaw_log_prior(_explained_by_equations(hypotheses, some))
    return _gain(state, hypotheses.discrepancy, size, beside=True)[0]


def _explained_by_equations(hypotheses: SensorHypotheses, some: EffectSet) -> float:
    """Return √Δχ² that the equations of effects and thermometer explain."""
    return float(np.sqrt(max(some.explained, hypotheses.explained_by_thermometer)))


def _flaws(hypotheses: SensorHypotheses, fitted: Sequence[_Fitted]) -> list[float]:
    """Return ln of prior times evidence of what each set's equations lack.

    It is a smooth function of all that was logged, or follows one variable (not temperature
    alone: curves over it are what laws are told by), or looks like a kindred effect (a lag of two
    stages like a gradient), or by chance like another: what was fitted with that effect, right or
    flawed itself, is then this set in a flawed form. All four are equally likely.
    """
    flaws: dict[int, float] = {}
    for place in sorted(range(len(fitted)), key=lambda k: -len(fitted[k].set.names)):
        some = fitted[place].set
        larger = []
        for other, flaw in flaws.items():
            further = Counter(fitted[other].set.names) - Counter(some.names)
            if further.total() == 1 and len(fitted[other].set.names) == len(some.names) + 1:
                whole = np.logaddexp(_exact_weight(hypotheses, fitted[other].set), flaw)
                larger.append((next(iter(further)), fitted[other].set, float(whole)))
        flaws[place] = _flaw(hypotheses, fitted[place], larger)
    return [flaws[place] for place in range(len(fitted))]


def _flaw(
    hypotheses: SensorHypotheses, one: _Fitted, larger: Sequence[tuple[str, EffectSet, float]]
) -> float:
    """Return the flaw of one set; `larger`: effect more, set with it, its weight, flaw or not."""
    some = one.set
    explained = _explained_by_equations(hypotheses, some)
    log_prior = priors.flaw_log_prior(explained)
    likeness = priors.flaw_log_prior(explained, priors.LIKENESS_SHARE, priors.LIKENESS_SHARE_LN)
    left_out = {'temperature', *one.variables_of_larger}
    variables = [r.term for r in hypotheses.regressors if r.depends_on not in left_out]
    single = _together(hypotheses, some, one.state, variables, log_prior, beside=True)
    single.append(one.course + _at(one.course_size, log_prior))
    kin = _kin(hypotheses, some)
    alike: list[float] = []
    others: list[float] = []
    for further, with_it, weight in larger:
        size = float(np.sqrt(max(with_it.explained - some.explained, 0.0)))
        gain = with_it.log_posterior - with_it.log_prior + some.log_prior - some.log_posterior
        (alike if further in kin else others).append(gain + weight + _at(size, likeness))
    ways = [(one.free_flaw, 1), (log_sum(single), len(single))]
    ways += [(log_sum(alike), len(kin))] if alike else []
    every = len(hypotheses.families) + len(hypotheses.guesses)
    ways += [(log_sum(others), every)] if others else []
    parts = [gain - float(np.log(count * len(ways))) for gain, count in ways]
    return log_sum(parts) + float(np.log(priors.FORM_APPROXIMATE))


def _kin(hypotheses: SensorHypotheses, some: EffectSet) -> set[str]:
    """Return the families kindred to an effect of the set, or to the temperature's errors."""
    families = [*hypotheses.families, *hypotheses.guesses]
    if not some.components:
        return {f.name for f in families if f.effect.kin == 'temperature'}
    effects = [c.form.effect for c in some.components]
    return {f.name for f in families if any(e.is_kin_of(f.effect()) for e in effects)}


def _common_mode(hypotheses: SensorHypotheses, some: EffectSet) -> float:
    """Return ln of what speaks for a course over time that the runs repeat from their start.

    One that only the axes share says nothing: slow noise may be common to them.
    """
    terms = [term for c in some.components for term in c.form.terms]
    terms.append(hypotheses.thermometer)
    return 0.5 * coherence(hypotheses.design, terms).runs


def _at(size: float, log_prior: FloatArray) -> float:
    """Return ln of a prior over AMPLITUDES at an amplitude [√Δχ²]."""
    known = float(np.log(max(size, priors.AMPLITUDES[0])))
    return float(np.interp(known, np.log(priors.AMPLITUDES), log_prior))


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
