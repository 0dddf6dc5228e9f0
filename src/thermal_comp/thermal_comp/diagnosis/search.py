# SPDX-License-Identifier: Apache-2.0
"""Search for the effects a residual holds: forward selection with swaps and merges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import PreparedRun
from thermal_comp.diagnosis.candidates import Family, Form, moved_forms
from thermal_comp.diagnosis.thresholds import threshold_of
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnGroup, ColumnSource
from thermal_comp.model.values import NoiseModel

MOST_EFFECTS = 5
"""Effects tried on one sensor before the search gives up."""
SCREENED = 6
"""Forms of a family that are scored exactly."""
SHAPE_STEPS = (1.25, 1.1, 1.04)
"""Factors by which shape parameters are moved."""
EDGE_S = 300.0
"""A step this near to a cycle's edge is the cycle's [s]."""
FORM_SHARE = 0.02
"""Share of Δχ² that a flaw in an effect's form may cost without doubting its name."""
NESTED_SHARE = 0.005
"""Share of Δχ² from which a richer form says more than that every law bends a little."""
CONFIRMED = 10.0
"""χ² another sensor adds to an effect from which no other stands for it."""


@dataclass(frozen=True)
class ScoredForm:
    """A form with what it adds to the effects already there."""

    form: Form
    evidence: float
    delta_chi2: float
    rank: int

    @property
    def name(self) -> str:
        """Catalogue name of the effect."""
        return self.form.effect.name


@dataclass
class Search:
    """The search over one sensor's families."""

    design: CandidateDesign
    families: Sequence[Family]
    thresholds: Mapping[str, float] | None = None
    vetoed: list[str] = field(default_factory=list)
    support: Mapping[str, float] = field(default_factory=dict)
    """χ² that another sensor adds to an effect both of them feel."""
    untried: frozenset[str] = frozenset()
    """Effects that act on the sensor but need a channel that was not logged."""
    least_delta_chi2: Mapping[str, float] = field(default_factory=dict)
    """Δχ² below which an effect is but a flaw in the form of one in the model."""

    @property
    def bic_penalty(self) -> float:
        """Evidence each parameter costs: ln of the number of block means."""
        return float(np.log(self.design.rows))

    def threshold(self, scored: ScoredForm) -> float:
        """Return the evidence the effect needs before it is named."""
        return threshold_of(scored.form.effect, self.thresholds)

    def run(self) -> list[ScoredForm]:
        """Return the effects found, strongest first."""
        chosen: list[Form] = []
        while len(chosen) < MOST_EFFECTS:
            best = self._best_addition(chosen)
            if best is None:
                break
            chosen = self._refined(self._renamed([*chosen, best.form]))
        chosen = self._pruned(self._simplified(self._pruned(chosen)))
        chosen = self._without_edges(chosen)
        return sorted((self.score(chosen, f) for f in chosen), key=lambda r: -r.evidence)

    def total(self, forms: Sequence[Form]) -> tuple[float, float, int]:
        """Return evidence, Δχ² and rank of the forms together."""
        terms = [term for form in forms for term in form.terms]
        delta_chi2, rank = self.design.solve(terms)
        delta_chi2 += sum(self.support.get(form.effect.name, 0.0) for form in forms)
        free = sum(form.free for form in forms)
        return delta_chi2 - (rank + free) * self.bic_penalty, delta_chi2, rank

    def score(self, chosen: Sequence[Form], form: Form) -> ScoredForm:
        """Return what a form adds to the others that were chosen."""
        others = [f for f in chosen if f is not form]
        before, with_it = self.total(others), self.total([*others, form])
        return ScoredForm(
            form, with_it[0] - before[0], with_it[1] - before[1], with_it[2] - before[2]
        )

    def best_form(self, chosen: Sequence[Form], family: Family) -> ScoredForm | None:
        """Return the family's form that adds most to those chosen."""
        forms = list(family.forms)
        if len(forms) > SCREENED:
            forms = [forms[k] for k in np.argsort(self._screened(chosen, forms))[-SCREENED:]]
        before = self.total(chosen)
        best: ScoredForm | None = None
        for form in forms:
            evidence, delta_chi2, rank = self.total([*chosen, form])
            scored = ScoredForm(
                form, evidence - before[0], delta_chi2 - before[1], rank - before[2]
            )
            if best is None or scored.evidence > best.evidence:
                best = scored
        return best

    def _screened(self, chosen: Sequence[Form], forms: Sequence[Form]) -> FloatArray:
        """Return the evidence of each form, roughly: what is chosen counts as free per axis."""
        columns = [[c for term in form.terms for c in term.columns] for form in forms]
        known = [c for form in chosen for term in form.terms for c in term.columns]
        every = sorted({c for some in columns for c in some})
        normal, right = self.design.reduced(known, every)
        place = {c: k for k, c in enumerate(every)}
        evidence = np.full(len(forms), -np.inf)
        for count in {len(some) for some in columns}:
            which = [k for k, some in enumerate(columns) if len(some) == count]
            index = np.array([[place[c] for c in columns[k]] for k in which])
            blocks = normal[:, index[:, :, None], index[:, None, :]]
            rows = right[:, index]
            blocks = blocks + 1e-7 * np.eye(count)
            gains = (rows * np.linalg.solve(blocks, rows[..., None])[..., 0]).sum(axis=(0, 2))
            free = np.array([forms[k].free for k in which])
            evidence[which] = gains - (3 * count + free) * self.bic_penalty
        return evidence

    def ranking(self, chosen: Sequence[Form]) -> list[ScoredForm]:
        """Return the best form of every family that is not chosen, strongest first."""
        names = {f.effect.name for f in chosen if not f.effect.repeatable}
        scored = [self.best_form(chosen, f) for f in self.families if f.name not in names]
        found = [r for r in scored if r is not None and r.rank > 0]
        return sorted(found, key=lambda r: -r.evidence)

    def _best_addition(self, chosen: Sequence[Form]) -> ScoredForm | None:
        for scored in self.ranking(chosen):
            if scored.evidence <= 0.0:
                break
            if scored.evidence < self.threshold(scored):
                continue
            if scored.delta_chi2 < self.least_delta_chi2.get(scored.name, 0.0):
                continue
            if self._confirmed_by_cycles(chosen, scored.form):
                return scored
            self.vetoed.append(scored.name)
        return None

    def _renamed(self, chosen: list[Form]) -> list[Form]:
        """Let every effect be replaced by a better one, and two by one, until nothing improves."""
        for _ in range(6):
            better = self._better_single(chosen) or self._better_merged(chosen)
            if better is None:
                break
            chosen = better
        return chosen

    def _better_single(self, chosen: list[Form]) -> list[Form] | None:
        here = self.total(chosen)[0]
        for k in range(len(chosen)):
            others = chosen[:k] + chosen[k + 1 :]
            ranking = self.ranking(others)
            if ranking and ranking[0].form is not chosen[k]:
                trial = [*others, ranking[0].form]
                if self.total(trial)[0] > here + 1.0:
                    return trial
        return None

    def _better_merged(self, chosen: list[Form]) -> list[Form] | None:
        here = self.total(chosen)[0]
        for pair in combinations(range(len(chosen)), 2):
            others = [f for k, f in enumerate(chosen) if k not in pair]
            ranking = self.ranking(others)
            if ranking and self.total([*others, ranking[0].form])[0] > here:
                return [*others, ranking[0].form]
        return None

    def _pruned(self, chosen: list[Form]) -> list[Form]:
        while chosen:
            scored = [self.score(chosen, form) for form in chosen]
            weakest = min(scored, key=lambda r: r.evidence - self.threshold(r))
            if weakest.evidence >= self.threshold(weakest):
                break
            chosen = [form for form in chosen if form is not weakest.form]
        return chosen

    def _simplified(self, chosen: list[Form]) -> list[Form]:
        """Let a simpler effect stand for a richer one that gains no more than a flaw in form."""
        for form in tuple(chosen):
            if self.support.get(form.effect.name, 0.0) > CONFIRMED:
                continue
            others = [f for f in chosen if f is not form]
            here, alone = self.total(chosen)[1], self.score([], form).delta_chi2
            taken = {f.effect.name for f in others}
            for family in self.families:
                if family.name in taken or not family.effect.stands_for(type(form.effect)):
                    continue
                simpler = self.best_form(others, family)
                if simpler is None:
                    continue
                refined = self._best_shape(others, simpler.form)
                if here - self.total([*others, refined])[1] < NESTED_SHARE * alone:
                    chosen = [*others, refined]
                    break
        return chosen

    def _refined(self, chosen: list[Form]) -> list[Form]:
        """Move the shape parameters off their grid while that explains more."""
        for k, form in enumerate(chosen):
            others = chosen[:k] + chosen[k + 1 :]
            chosen = [*chosen[:k], self._best_shape(others, form), *chosen[k + 1 :]]
        return chosen

    def _best_shape(self, others: list[Form], form: Form) -> Form:
        """Try steps of every shape parameter, ever smaller."""
        if form.free == 0:
            return form
        best, delta_chi2 = form, self.total([*others, form])[1]
        for ratio in SHAPE_STEPS:
            moved = True
            while moved:
                moved = False
                trials = moved_forms(self.design, best, ratio)
                gains = [self.total([*others, trial])[1] for trial in trials]
                if gains and max(gains) > delta_chi2 + 0.1:
                    best, delta_chi2, moved = trials[int(np.argmax(gains))], max(gains), True
        return best

    def _without_edges(self, chosen: list[Form]) -> list[Form]:
        """Drop steps at the edges of cycles where every cycle has a level of its own anyway.

        A level changes in the middle of a block, or a row before the cycle is logged: to a step
        that is worth something, but it is no other effect.
        """
        if not any(form.effect.levels_per_cycle for form in chosen):
            return chosen
        edges = np.concatenate([[-np.inf], *(_cycle_edges(r) for r in self.design.source.runs)])
        return [
            form
            for form in chosen
            if not form.effect.edges or np.abs(edges - form.effect.edges[0]).min() > EDGE_S
        ]

    def _confirmed_by_cycles(self, chosen: Sequence[Form], form: Form) -> bool:
        """Leave one part out at a time: the effect must help to predict most of them."""
        design = self.design
        parts = np.unique(design.cv_group[design.cv_group > 0])
        if not form.effect.confirmed_by_cycles or len(parts) < 3:
            return True
        before = [term for f in chosen for term in f.terms]
        gains = [
            held_out_chi_square(design, before, int(part))
            - held_out_chi_square(design, [*before, *form.terms], int(part))
            for part in parts
        ]
        better = sum(delta_chi2 > 0.0 for delta_chi2 in gains)
        return sum(gains) > 0.0 and better >= 0.6 * len(gains)


def held_out_chi_square(design: CandidateDesign, terms: Sequence[ColumnGroup], part: int) -> float:
    """Return χ² of one part, predicted from the others, in whitened rows."""
    kept = design.cv_group != part
    own, common = design.split_sizes(terms)
    own_columns = design.whitened_columns(terms)
    blocks, targets, tests, wanted = [], [], [], []
    for axis in range(3):
        base = design.base[axis]
        columns = np.zeros((len(base), 3 * (base.shape[1] + own) + common))
        start = axis * (base.shape[1] + own)
        columns[:, start : start + base.shape[1]] = base
        columns[:, start + base.shape[1] : start + base.shape[1] + own] = own_columns[axis][
            :, :own
        ]
        columns[:, columns.shape[1] - common :] = own_columns[axis][:, own:]
        blocks.append(columns[kept])
        targets.append(design.target[axis][kept])
        tests.append(columns[~kept])
        wanted.append(design.target[axis][~kept])
    train = np.concatenate(blocks)
    normal = train.T @ train
    right = train.T @ np.concatenate(targets)
    answer = np.linalg.lstsq(normal, right, rcond=1e-10)[0]
    return float(((np.concatenate(wanted) - np.concatenate(tests) @ answer) ** 2).sum())


def least_delta_chi2(
    source: ColumnSource,
    sensor: Sensor,
    noise: NoiseModel,
    known: Sequence[Effect],
    catalogue: Mapping[str, type[Effect]],
) -> dict[str, float]:
    """Return by effect the Δχ² that a flaw in the form of a known effect may leave to it."""
    pairs = [(r, k) for k in known for r in catalogue.values() if k.stands_for(r)]
    if not pairs:
        return {}
    simpler = {effect.name for _, effect in pairs}
    design = CandidateDesign(source, sensor, noise, [e for e in known if e.name not in simpler])
    gains = {e.name: design.solve([design.term(e)])[0] for e in known if e.name in simpler}
    least: dict[str, float] = {}
    for richer, effect in pairs:
        share = FORM_SHARE if richer.name in effect.flaw_resembles else NESTED_SHARE
        least[richer.name] = max(least.get(richer.name, 0.0), share * gains[effect.name])
    return least


def _cycle_edges(run: PreparedRun) -> FloatArray:
    """Return the times [s] at which a cycle begins or the last one ends."""
    return np.asarray(run.time[np.flatnonzero(np.diff(run.cycle)) + 1])
