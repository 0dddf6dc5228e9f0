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
    COHERENT,
    LOGGED,
    Left,
    best_hinge,
    coherence,
    common_mode,
    dependence,
    explainable,
    strongest_judge,
)
from thermal_comp.diagnosis.generic_regressors import Judge
from thermal_comp.diagnosis.search import FORM_SHARE, Rated, Search
from thermal_comp.diagnosis.spectral_lines import steadiness
from thermal_comp.effects.effect import LEAST_EVIDENCE, Effect, contains, joined_effects
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.values import ModelError

DOMINANT = 0.95
"""Effects that explain this share together keep their names; the rest is their form."""
SECOND = 0.03
"""An effect below this share of the strongest one's gain may be part of that one's form."""
MINOR = 0.02
"""Below this share any other effect may be."""
RIVAL_EVIDENCE = 10.0
RIVAL_SHARE = 0.98
"""Rivals: within this evidence, or this share of the χ² gain."""
FAINT = 60.0
"""Evidence below which the price of parameters alone may decide between forms."""
CHAIN = 3
"""This many families on one sensor are a sign of something else."""
PLAINER = 20.0
"""Evidence by which a line with one bend has to beat a curvature."""
STEADY = 0.43
"""Share of a line's power that is steady at least: a line that a current gates keeps half."""
COURSE_SHARE = 0.012
"""Evidence of a common course beside the effects, as a share of their gain, that doubts them."""


@dataclass(frozen=True)
class Named:
    """An effect that is named, with its rivals."""

    rated: Rated
    rivals: tuple[tuple[str, float], ...]
    """Names and shares of the gain, best first."""
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
    named: tuple[Named, ...] = ()
    depends_on: str | None = None
    evidence: float = 0.0
    tried: tuple[str, ...] = ()
    """Effects that together came closest where none is named."""
    rejected: tuple[Rejected, ...] = ()
    """Effects refused because what was held out contradicts them."""


def decide(search: Search, judges: Sequence[Judge], missing: Sequence[str]) -> Outcome:
    """Return what is said about the sensor; `missing` are channels no run has logged."""
    found = search.run()
    left = strongest_judge(search, judges, found)
    if not found:
        return _nothing_found(search, judges, missing, left)
    total = search.total([r.form for r in found])[1] + (left.gain if left else 0.0)
    major = _majors(search, found)
    share = search.total([r.form for r in major])[1] / total
    names = {r.name for r in major}
    wandering = [r for r in major if _wanders(search, judges, r)]
    if wandering:
        tried = tuple(dict.fromkeys(r.name for r in found))
        return Outcome('unexplained', (), 'frequency', wandering[0].evidence, tried)
    relevant = [c for c in CHANNELS_OF[search.bank.sensor] if c in missing and c in LOGGED]
    fits = left is None or left.gain < FORM_SHARE * total or share >= DOMINANT
    doubtful = (
        len(names) >= CHAIN
        or (relevant and len(names) > 1)
        or (len(names) > 1 and _one_curve(search, judges, major))
        or sum(r.form.effect.repeatable for r in major) > len(search.bank.source.runs)
        or not _suffices(search, judges, major)
        or _leaves_a_course(search, found)
        or _bends_plainly(search, major)
    )
    if fits and share >= DOMINANT and not doubtful:
        rated = sorted(
            (search.rate([m.form for m in major], m.form) for m in major),
            key=lambda r: -r.evidence,
        )
        rough = left is not None or len(major) < len(found)
        return Outcome('named', tuple(_named(search, rated, r, approximate=rough) for r in rated))
    return _without_name(search, judges, missing, found)


def _nothing_found(
    search: Search, judges: Sequence[Judge], missing: Sequence[str], left: Left | None
) -> Outcome:
    if left is not None:
        return _without_name(search, judges, missing, [])
    course = common_mode(search, missing)
    if course is None:
        return Outcome('complete')
    for rated in search.ranking([]):
        # Its evidence is short of a threshold that is high because noise drifts as well: on each
        # axis and in each run by itself, though.
        effect = rated.form.effect
        slow = effect.time_only and not effect.per_run and rated.evidence > LEAST_EVIDENCE
        if slow and common_mode(search, missing, [rated]) is None:
            return Outcome('named', (replace(_named(search, [rated], rated), shared=True),))
    return Outcome(course.kind, (), course.depends_on, course.evidence)


def _suffices(search: Search, judges: Sequence[Judge], major: Sequence[Rated]) -> bool:
    """Tell whether the effects explain most of what anything could, noise allowed for."""
    terms = [term for r in major for term in r.form.terms]
    gain, rank = search.bank.solve(terms)
    everything, spread = explainable(search, judges, terms)
    return gain - rank >= ADEQUATE * everything - 3.0 * spread


def _wanders(search: Search, judges: Sequence[Judge], rated: Rated) -> bool:
    """Tell whether an effect is a line in the spectrum that one frequency does not describe.

    What repeats with the thermal cycle has lines as well: then a variable explains more.
    """
    frequency = rated.form.effect.line_frequency
    bank = search.bank
    if frequency is None or steadiness(bank.source.runs, bank.sensor, frequency) >= STEADY:
        return False
    alone = search.rate([], rated.form).gain
    return all(bank.solve([judge.term])[0] < alone for judge in judges)


def _bends_plainly(search: Search, major: Sequence[Rated]) -> bool:
    """Tell whether a curvature that stands alone is rather a line with one bend."""
    if len(major) != 1 or not major[0].form.effect.curve_over_temperature:
        return False
    return best_hinge(search).evidence > search.rate([], major[0].form).evidence + PLAINER


def _leaves_a_course(search: Search, found: Sequence[Rated]) -> bool:
    """Tell whether the axes still have much in common beside what was found."""
    terms = [term for r in found for term in r.form.terms]
    left = coherence(search.bank, terms).evidence
    return left > max(COHERENT, COURSE_SHARE * search.bank.solve(terms)[0])


def _one_curve(search: Search, judges: Sequence[Judge], major: Sequence[Rated]) -> bool:
    """Tell whether one curve over temperature does what several kindred effects do together."""
    kin = {r.form.effect.kin for r in major}
    if len(kin) > 1 or '' in kin:
        return False
    gain, rank = search.bank.solve([term for r in major for term in r.form.terms])
    curves = (search.bank.solve([j.term]) for j in judges if j.depends_on == 'temperature')
    return any(g - r >= gain - rank for g, r in curves)


def _majors(search: Search, found: Sequence[Rated]) -> list[Rated]:
    """Return the effects that are more than a flaw in the strongest one's form, and hold alone."""
    alone = [search.rate([], r.form) for r in found]
    first = max(range(len(found)), key=lambda k: alone[k].gain)
    strongest = found[first].form.effect
    # What a line's form may lack lies beside it in the spectrum: nothing slow stands for it.
    minor = MINOR if strongest.line_frequency is None else 0.0
    shares = [SECOND if r.form.effect.is_kin_of(strongest) else minor for r in found]
    kept = [
        r
        for k, (r, share) in enumerate(zip(found, shares, strict=True))
        if k == first or r.gain > share * alone[first].gain
    ]
    while len(kept) > 1:
        forms = [r.form for r in kept]
        spare = [search.rate(forms, f) for f in forms if f is not found[first].form]
        weakest = min(spare, key=lambda r: r.evidence)
        if weakest.evidence >= search.threshold(weakest):
            break
        kept = [r for r in kept if r.form is not weakest.form]
    return kept


def _named(
    search: Search, found: Sequence[Rated], rated: Rated, *, approximate: bool = False
) -> Named:
    others = [r.form for r in found if r.form is not rated.form]
    ranking = [r for r in search.ranking(others) if r.name != rated.name]
    rivals = [(r.name, r.gain / rated.gain) for r in ranking[:4] if r.gain > 0.0]
    close: list[Effect] = []
    richer: list[Effect] = []
    for rival in ranking:
        effect = rival.form.effect
        near = rival.evidence > rated.evidence - RIVAL_EVIDENCE
        alike = rival.gain > RIVAL_SHARE * rated.gain and rival.evidence > 0.0
        if rated.form.effect.is_contained_in(effect):
            more = rival.rank + rival.form.free - rated.rank - rated.form.free
            least = rated.form.effect.enrichment * max(more, 1)
            near = rival.gain - rated.gain > least
            alike = False
        contained = any(contains(effect, other) for other in close)
        if contained and (near or (alike and rated.evidence < FAINT)):
            richer.append(effect)
        elif (near or alike) and not contained:
            close.append(effect)
    # A richer form of a rival stands behind those that are something else.
    close += richer
    names = [effect.name for effect in close]
    for effect in (rated.form.effect, *close):
        if effect.unseen_twin in search.untried:
            names = [*names[:1], effect.unseen_twin]
    return Named(rated, tuple(rivals), tuple(names[:2]), approximate)


def _without_name(
    search: Search, judges: Sequence[Judge], missing: Sequence[str], found: Sequence[Rated]
) -> Outcome:
    said = dependence(search, judges, missing, found)
    tried = tuple(dict.fromkeys(r.name for r in found))
    return Outcome(said.kind, (), said.depends_on, said.evidence, tried)


MOST_REJECTED = 8
"""Effects refused before the sensor is left without a name."""


def decide_confirmed(
    search: Search, judges: Sequence[Judge], missing: Sequence[str], base: Sequence[Effect]
) -> Outcome:
    """Return what is said about the sensor; no effect whose held-out error is above the base's.

    Where cycles repeat, leaving one out confirms an effect while it is searched. Without them any
    curve follows a single sweep, and only blocks left out tell which one foresees the rest.
    """
    outcome = decide(search, judges, missing)
    if all(run.has_cycles for run in search.bank.source.runs) or outcome.kind != 'named':
        return outcome
    before = _held_out(search, base)
    rejected: list[Rejected] = []
    while outcome.kind == 'named' and len(rejected) < MOST_REJECTED:
        named = [n.rated.form.effect for n in outcome.named]
        after = _held_out(search, [*base, *named])
        if after <= before:
            break
        worst = outcome.named[0].rated
        rejected.append(Rejected(worst.name, worst.evidence, after, before))
        families = [f for f in search.families if f.name not in {r.name for r in rejected}]
        search = replace(search, families=families)
        outcome = decide(search, judges, missing)
    return replace(outcome, rejected=tuple(rejected))


def _held_out(search: Search, effects: Sequence[Effect]) -> float:
    """Return the rms over the axes of the error on blocks the fit has not seen [unit]."""
    bank = search.bank
    noise = {bank.sensor: bank.noise}
    try:
        model = fit_prepared({bank.sensor: joined_effects(effects)}, bank.source.runs, noise=noise)
    except ModelError:
        return float('inf')
    compared = compare_prepared(model, bank.source.runs, noise=noise).sensors[bank.sensor]
    return float(np.sqrt(np.mean(np.square(compared.held_out_rms))))
