# SPDX-License-Identifier: Apache-2.0
"""From what explains a residual to what is said about it: named, unexplained or unlogged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from thermal_comp.comparison.compare import compare_prepared
from thermal_comp.diagnosis.dependence import (
    ADEQUATE,
    CHANNELS_OF,
    COMMON_MODE_EVIDENCE,
    LOGGED,
    RemainingDependence,
    best_hinge,
    coherence,
    common_mode,
    dependence,
    explainable,
    strongest_regressor,
)
from thermal_comp.diagnosis.generic_regressors import GenericRegressor
from thermal_comp.diagnosis.search import FORM_SHARE, ScoredForm, Search
from thermal_comp.diagnosis.spectral_lines import steadiness
from thermal_comp.effects.effect import LEAST_EVIDENCE, Effect, contains, joined_effects
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.values import ModelError

DOMINANT = 0.95
"""Effects that explain this share together keep their names; the rest is their form."""
SECOND = 0.03
"""A kindred effect below this share of the strongest one's Δχ² may be a flaw in its form."""
MINOR = 0.02
"""Any other effect below this share may be."""
RIVAL_EVIDENCE = 10.0
RIVAL_SHARE = 0.98
"""A rival lies within this evidence, or this share of Δχ², of what is named."""
FAINT = 60.0
"""Evidence below which the BIC penalty alone may decide between forms."""
CHAIN = 3
"""This many families on one sensor are a sign of something else."""
PLAINER = 20.0
"""Evidence by which a line with one bend has to beat a curvature."""
STEADY = 0.43
"""Share of a line's power that is steady at least: a line that a current gates keeps half."""
COURSE_SHARE = 0.012
"""Evidence of a common course beside the effects, as a share of their Δχ², that doubts them."""
MOST_REJECTED = 8
"""Effects refused before the sensor is left without a name."""


@dataclass(frozen=True)
class IdentifiedEffect:
    """An effect that is named, with its rivals."""

    scored: ScoredForm
    rivals: tuple[tuple[str, float], ...]
    """Names and shares of Δχ², best first."""
    ambiguous_with: tuple[str, ...]
    approximate: bool = False
    """True where its form leaves more than noise."""
    shared: bool = False
    """True where axes and runs share its course: then the least threshold of all will do."""


@dataclass(frozen=True)
class Rejected:
    """An effect that explains what was seen but not what was held out."""

    name: str
    evidence: float
    error_with: float
    """Held-out rms with the effect [unit]."""
    error_without: float


@dataclass(frozen=True)
class Outcome:
    """What is said about one sensor."""

    kind: Literal['complete', 'named', 'unexplained', 'unlogged']
    named: tuple[IdentifiedEffect, ...] = ()
    depends_on: str | None = None
    evidence: float = 0.0
    tried: tuple[str, ...] = ()
    """Effects that together came closest where none is named."""
    rejected: tuple[Rejected, ...] = ()
    """Effects refused because what was held out contradicts them."""


def decide_confirmed(
    search: Search,
    regressors: Sequence[GenericRegressor],
    missing: Sequence[str],
    base: Sequence[Effect],
) -> Outcome:
    """Return what is said about the sensor; no effect whose held-out error is above the base's.

    Where cycles repeat, leaving one out confirms an effect while it is searched. Without them any
    curve follows a single sweep, and only blocks left out tell which one foresees the rest.
    """
    outcome = decide(search, regressors, missing)
    if all(run.has_cycles for run in search.design.source.runs) or outcome.kind != 'named':
        return outcome
    before = _held_out(search, base)
    rejected: list[Rejected] = []
    while outcome.kind == 'named' and len(rejected) < MOST_REJECTED:
        named = [n.scored.form.effect for n in outcome.named]
        after = _held_out(search, [*base, *named])
        if after <= before:
            break
        worst = outcome.named[0].scored
        rejected.append(Rejected(worst.name, worst.evidence, after, before))
        families = [f for f in search.families if f.name not in {r.name for r in rejected}]
        search = replace(search, families=families)
        outcome = decide(search, regressors, missing)
    return replace(outcome, rejected=tuple(rejected))


def decide(
    search: Search, regressors: Sequence[GenericRegressor], missing: Sequence[str]
) -> Outcome:
    """Return what is said about the sensor; `missing` are channels no run has logged."""
    found = search.run()
    left = strongest_regressor(search, regressors, found)
    if not found:
        return _nothing_found(search, regressors, missing, left)
    total = search.total([r.form for r in found])[1] + (left.delta_chi2 if left else 0.0)
    major = _majors(search, found)
    share = search.total([r.form for r in major])[1] / total
    names = {r.name for r in major}
    wandering = [r for r in major if _wanders(search, regressors, r)]
    if wandering:
        tried = tuple(dict.fromkeys(r.name for r in found))
        return Outcome('unexplained', (), 'frequency', wandering[0].evidence, tried)
    relevant = [c for c in CHANNELS_OF[search.design.sensor] if c in missing and c in LOGGED]
    fits = left is None or left.delta_chi2 < FORM_SHARE * total or share >= DOMINANT
    doubtful = (
        len(names) >= CHAIN
        or (relevant and len(names) > 1)
        or (len(names) > 1 and _one_curve(search, regressors, major))
        or sum(r.form.effect.repeatable for r in major) > len(search.design.source.runs)
        or not _suffices(search, regressors, major)
        or _leaves_a_course(search, found)
        or _bends_plainly(search, major)
    )
    if fits and share >= DOMINANT and not doubtful:
        scored = sorted(
            (search.score([m.form for m in major], m.form) for m in major),
            key=lambda r: -r.evidence,
        )
        rough = left is not None or len(major) < len(found)
        return Outcome(
            'named', tuple(_identified(search, scored, r, approximate=rough) for r in scored)
        )
    return _without_name(search, regressors, missing, found)


def _nothing_found(
    search: Search,
    regressors: Sequence[GenericRegressor],
    missing: Sequence[str],
    left: RemainingDependence | None,
) -> Outcome:
    if left is not None:
        return _without_name(search, regressors, missing, [])
    course = common_mode(search, missing)
    if course is None:
        return Outcome('complete')
    for scored in search.ranking([]):
        # Its evidence is short of a threshold that is high because noise drifts as well: on each
        # axis and in each run by itself, though.
        effect = scored.form.effect
        slow = effect.time_only and not effect.per_run and scored.evidence > LEAST_EVIDENCE
        if slow and common_mode(search, missing, [scored]) is None:
            return Outcome('named', (replace(_identified(search, [scored], scored), shared=True),))
    return Outcome(course.kind, (), course.depends_on, course.evidence)


def _suffices(
    search: Search, regressors: Sequence[GenericRegressor], major: Sequence[ScoredForm]
) -> bool:
    """Tell whether the effects explain most of what anything could, noise allowed for."""
    terms = [term for r in major for term in r.form.terms]
    delta_chi2, rank = search.design.solve(terms)
    everything, spread = explainable(search, regressors, terms)
    return delta_chi2 - rank >= ADEQUATE * everything - 3.0 * spread


def _wanders(search: Search, regressors: Sequence[GenericRegressor], scored: ScoredForm) -> bool:
    """Tell whether an effect is a line in the spectrum that one frequency does not describe.

    What repeats with the thermal cycle has lines as well: then a variable explains more.
    """
    frequency = scored.form.effect.line_frequency
    design = search.design
    if frequency is None or steadiness(design.source.runs, design.sensor, frequency) >= STEADY:
        return False
    alone = search.score([], scored.form).delta_chi2
    return all(design.solve([regressor.term])[0] < alone for regressor in regressors)


def _bends_plainly(search: Search, major: Sequence[ScoredForm]) -> bool:
    """Tell whether a curvature that stands alone is rather a line with one bend."""
    if len(major) != 1 or not major[0].form.effect.curve_over_temperature:
        return False
    return best_hinge(search).evidence > search.score([], major[0].form).evidence + PLAINER


def _leaves_a_course(search: Search, found: Sequence[ScoredForm]) -> bool:
    """Tell whether the axes still have much in common beside what was found."""
    terms = [term for r in found for term in r.form.terms]
    left = coherence(search.design, terms).evidence
    return left > max(COMMON_MODE_EVIDENCE, COURSE_SHARE * search.design.solve(terms)[0])


def _one_curve(
    search: Search, regressors: Sequence[GenericRegressor], major: Sequence[ScoredForm]
) -> bool:
    """Tell whether one curve over temperature does what several kindred effects do together."""
    kin = {r.form.effect.kin for r in major}
    if len(kin) > 1 or '' in kin:
        return False
    delta_chi2, rank = search.design.solve([term for r in major for term in r.form.terms])
    curves = (search.design.solve([j.term]) for j in regressors if j.depends_on == 'temperature')
    return any(g - r >= delta_chi2 - rank for g, r in curves)


def _majors(search: Search, found: Sequence[ScoredForm]) -> list[ScoredForm]:
    """Return the effects that are more than a flaw in the strongest one's form, and hold alone."""
    alone = [search.score([], r.form) for r in found]
    first = max(range(len(found)), key=lambda k: alone[k].delta_chi2)
    strongest = found[first].form.effect
    # What a line's form may lack lies beside it in the spectrum: nothing slow stands for it.
    minor = MINOR if strongest.line_frequency is None else 0.0
    shares = [SECOND if r.form.effect.is_kin_of(strongest) else minor for r in found]
    kept = [
        r
        for k, (r, share) in enumerate(zip(found, shares, strict=True))
        if k == first or r.delta_chi2 > share * alone[first].delta_chi2
    ]
    while len(kept) > 1:
        forms = [r.form for r in kept]
        spare = [search.score(forms, f) for f in forms if f is not found[first].form]
        weakest = min(spare, key=lambda r: r.evidence)
        if weakest.evidence >= search.threshold(weakest):
            break
        kept = [r for r in kept if r.form is not weakest.form]
    return kept


def _identified(
    search: Search, found: Sequence[ScoredForm], scored: ScoredForm, *, approximate: bool = False
) -> IdentifiedEffect:
    others = [r.form for r in found if r.form is not scored.form]
    ranking = [r for r in search.ranking(others) if r.name != scored.name]
    rivals = [
        (r.name, r.delta_chi2 / scored.delta_chi2) for r in ranking[:4] if r.delta_chi2 > 0.0
    ]
    close: list[Effect] = []
    richer: list[Effect] = []
    for rival in ranking:
        effect = rival.form.effect
        near = rival.evidence > scored.evidence - RIVAL_EVIDENCE
        alike = rival.delta_chi2 > RIVAL_SHARE * scored.delta_chi2 and rival.evidence > 0.0
        if scored.form.effect.is_contained_in(effect):
            more = rival.rank + rival.form.free - scored.rank - scored.form.free
            least = scored.form.effect.enrichment * max(more, 1)
            near = rival.delta_chi2 - scored.delta_chi2 > least
            alike = False
        contained = any(contains(effect, other) for other in close)
        if contained and (near or (alike and scored.evidence < FAINT)):
            richer.append(effect)
        elif (near or alike) and not contained:
            close.append(effect)
    # A richer form of a rival stands behind those that are something else.
    close += richer
    names = [effect.name for effect in close]
    for effect in (scored.form.effect, *close):
        if effect.unseen_twin in search.untried:
            names = [*names[:1], effect.unseen_twin]
    return IdentifiedEffect(scored, tuple(rivals), tuple(names[:2]), approximate)


def _without_name(
    search: Search,
    regressors: Sequence[GenericRegressor],
    missing: Sequence[str],
    found: Sequence[ScoredForm],
) -> Outcome:
    said = dependence(search, regressors, missing, found)
    tried = tuple(dict.fromkeys(r.name for r in found))
    return Outcome(said.kind, (), said.depends_on, said.evidence, tried)


def _held_out(search: Search, effects: Sequence[Effect]) -> float:
    """Return the rms over the axes of the error on blocks the fit has not seen [unit]."""
    design = search.design
    noise = {design.sensor: design.noise}
    try:
        model = fit_prepared(
            {design.sensor: joined_effects(effects)}, design.source.runs, noise=noise
        )
    except ModelError:
        return float('inf')
    compared = compare_prepared(model, design.source.runs, noise=noise).sensors[design.sensor]
    return float(np.sqrt(np.mean(np.square(compared.held_out_rms))))
