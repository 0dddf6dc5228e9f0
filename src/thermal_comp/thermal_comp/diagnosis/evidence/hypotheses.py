# SPDX-License-Identifier: Apache-2.0
"""Sets of effects that may explain a sensor's residual, with the evidence of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.spectral_lines import frequencies_told_apart
from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.candidates import (
    Family,
    Form,
    channels_not_logged,
    families,
    form_of,
    guesses,
    moved_forms,
    renewed,
)
from thermal_comp.diagnosis.evidence.effect_sets import Component, EffectSet, Names
from thermal_comp.diagnosis.evidence.generic_regressors import (
    GenericRegressor,
    all_variables,
    generic_regressors,
    lost_over_time,
)
from thermal_comp.diagnosis.evidence.nuisances import Response, nuisance_priors, thermometer_errors
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnGroup
from thermal_comp.linear.gaussian_evidence import (
    CoefficientPrior,
    ConditionedDesign,
    conditioned,
    joint_evidence,
    log_sum,
)

MOST_EFFECTS = 3
"""Effects in a set."""
KEPT_SETS = 5
"""Sets of each size that are extended."""
TRIED_ADDITIONS = 4
"""Effects each of them is extended by."""
LEAST_GAIN = 2.0
"""Least gain of ln evidence, before any prior, from which an addition is looked at closely."""
PROMISING_SHARE = 0.3
"""Share of the best single effect's gain a form may lose because the grid of shapes is coarse."""
SHAPE_RATIOS = (1.25, 1.06, 1.02, 1.005, 1.001, 1.0002, 1.00005, 1.00001)
"""Factors by which shape parameters are moved, ever smaller; the peak lies between them."""
LEAST_MOVE = 0.05
"""Gain of ln evidence from which a move goes on."""
MOST_MOVES = 12
"""Moves of a shape by one factor."""
MOST_STRAIN = 20.0
"""χ² of its errors by their prior up to which a thermometer is taken to have made them: those of
lagging ones have 6 and less, what is bent into them to follow a curvature of the sensor 40."""
CURVATURE_RATIO = 1.04
"""Factor over which the peak of the evidence over a shape parameter is measured."""


@dataclass(frozen=True)
class Addition:
    """What a family or a generic regressor would add to a set."""

    log_gain: float
    """ln of the evidence it adds, shapes and amplitude integrated."""
    peak: float
    """The same of its best form."""
    component: Component


class SensorHypotheses:
    """The sets of effects that may explain one sensor's residual."""

    def __init__(
        self,
        design: CandidateDesign,
        catalogue: Mapping[str, type[Effect]],
        response: Response | None = None,
    ) -> None:
        """`response`: what an error of the temperature does, where a model tells."""
        self.design = design
        self.thermometer = thermometer_errors(design, response)
        """Columns of what an error of the thermometer does."""
        self.nuisances = nuisance_priors(design, self.thermometer)
        self._told = 0.0
        """χ² of what other sensors tell of the thermometer."""
        self.families = _with_a_trace(design, families(design, catalogue))
        self.guesses = _with_a_trace(design, guesses(design, catalogue))
        """Effects of channels that were not logged but can be guessed."""
        self.without_channel = channels_not_logged(design, catalogue)
        """Effects that could act unseen, each with the channel that was not logged."""
        self.regressors: list[GenericRegressor] = []
        """Flexible functions of one variable each; none before `allow_unnamed`."""
        self.discrepancy = ColumnGroup(())
        """A smooth function of all that was logged, for what equations lack; likewise."""
        self.lost_over_time = lost_over_time(design)
        """Lost channel that may have any course over time; '' where none is."""
        self.unseen: dict[Names, dict[str, float]] = {}
        """Set → effect more → odds of it against none, where it would be too small to be seen."""
        self.rows = 3 * design.rows - design.base_rank
        self._fits: dict[Names, tuple[Component, ...]] = {}
        """Sets as they were fitted last: where a search begins anew, fits go on from there."""
        self._weigh_nuisances()

    def allow_unnamed(self) -> None:
        """Compute the columns that only what has no name is told by."""
        if not self.regressors:
            self.regressors = generic_regressors(self.design)
            self.discrepancy = all_variables(self.design, self.regressors)

    def inform(self, normal: FloatArray, right: FloatArray) -> None:
        """Take what others tell of the thermometer's errors, (p, p) and (p,), as further rows."""
        self._told += self.design.inform(self.thermometer, normal, right)
        self._weigh_nuisances()

    def _weigh_nuisances(self) -> None:
        likeliest = self._likeliest(())
        self.nothing = self.log_evidence(())[0]
        alone = self._joint((), likeliest[:1])[1]
        plausible = self._strain(likeliest[0]) <= MOST_STRAIN
        self.explained_by_thermometer = max(alone - self._told, 0.0) if plausible else 0.0
        """Δχ² of the thermometer's errors alone; 0 where they are larger than one has."""
        self._explained_by_nuisances = self._joint((), likeliest)[1]

    def _likeliest(self, components: Sequence[Component]) -> Sequence[CoefficientPrior]:
        """Return the alternative of the nuisances that is likeliest beside components.

        What a large effect leaves of the residual shows slow noise that is nothing beside it.
        """
        likely = [
            log_prior + self._joint(components, some)[0] for log_prior, some in self.nuisances
        ]
        return self.nuisances[int(np.argmax(likely))][1]

    def _strain(self, thermometer: CoefficientPrior) -> float:
        """Return χ² of the thermometer's errors by their prior, those that explain most."""
        normal, right = self.design.equations(thermometer.columns)
        deviation = thermometer.deviation
        scaled = normal.sum(axis=0) * np.outer(deviation, deviation)
        errors = np.linalg.solve(np.eye(len(deviation)) + scaled, deviation * right.sum(axis=0))
        return float(errors @ errors)

    def sets(self) -> list[EffectSet]:
        """Return the sets that were looked at, most probable first."""
        found: dict[Names, EffectSet] = {
            (): EffectSet((), float(np.log(priors.NOTHING)), float(np.log(priors.NOTHING)), 0.0)
        }
        grown = [found[()]]
        for size in range(1, MOST_EFFECTS + 1):
            larger = self._extended(grown, found)
            found |= larger
            best = max((s.log_posterior for s in larger.values()), default=-np.inf)
            smaller = [s.log_posterior for n, s in found.items() if len(n) < size]
            if best < max(smaller) - 1.0 and size > 1:
                break
            ranked = sorted(larger.values(), key=lambda s: -s.log_posterior)
            grown = [s for s in ranked if s.explained > 0.0][:KEPT_SETS]
            if not grown:
                break
        return sorted(found.values(), key=lambda s: -s.log_posterior)

    def _extended(
        self, sets: Sequence[EffectSet], known: Mapping[Names, EffectSet]
    ) -> dict[Names, EffectSet]:
        """Return the sets with one effect more, the promising ones fitted together."""
        larger: dict[Names, EffectSet] = {}
        for before in sets:
            additions = self.additions(before)
            leader = max((a.peak for a in additions.values()), default=0.0)
            ranked = sorted(additions.values(), key=lambda a: -a.peak)
            for place, addition in enumerate(ranked):
                names = tuple(sorted((*before.names, addition.component.name)))
                if names in larger or names in known:
                    continue
                promising = addition.peak > max(LEAST_GAIN, PROMISING_SHARE * leader - 15.0)
                most = TRIED_ADDITIONS if before.components else 2 * TRIED_ADDITIONS
                if promising and place < most:
                    larger[names] = self.fitted_set((*before.components, addition.component))
                elif not before.components:
                    prior = self.log_prior(1)
                    one = (addition.component,)
                    larger[names] = EffectSet(one, prior + addition.log_gain, prior, 0.0)
            if before.components:
                self.unseen[before.names] = self._unseen(before, additions)
        return larger

    def _unseen(self, before: EffectSet, additions: Mapping[str, Addition]) -> dict[str, float]:
        """Return the odds of effects beside a set that would be too small to be seen."""
        size = len(before.components)
        more = self.log_prior(size + 1) - self.log_prior(size)
        return {
            name: float(np.exp(more + one.log_gain))
            for name, one in additions.items()
            if one.peak < LEAST_GAIN and not one.component.form.effect.guessed_channel
        }

    def additions(self, before: EffectSet, *, thermometer: bool = True) -> dict[str, Addition]:
        """Return what each family not in the set would add to it, roughly.

        `thermometer`: beside the thermometer's errors.
        """
        strongest = float(np.sqrt(before.explained)) if before.components else None
        amplitude_prior = priors.amplitude_log_prior(strongest)
        taken = {c.name for c in before.components if not c.form.effect.repeatable}
        offered = [f for f in (*self.families, *self.guesses) if f.name not in taken]
        if before.components:
            known = [c.form for c in before.components]
            offered = [
                renewed(self.design, f, known) if f.effect.repeatable else f for f in offered
            ]
        state = self.conditioned(before.components, thermometer=thermometer)
        # In a short run the edge of a known step may be all that another could be.
        return {f.name: self._addition(state, f, amplitude_prior) for f in offered if f.forms}

    def _addition(
        self,
        state: ConditionedDesign,
        family: Family,
        amplitude_prior: FloatArray,
    ) -> Addition:
        count = self._form_count(family)
        before = state.log_evidence
        integrals: list[float] = []
        best: tuple[float, Component] | None = None
        for forms in _alike(family.forms):
            columns = np.array([[c for t in form.terms for c in t.columns] for form in forms])
            evidence, _ = state.evidences(
                columns, priors.AMPLITUDES, shared=forms[0].terms[0].shared
            )
            weighted = evidence + amplitude_prior - before
            each = np.logaddexp.reduce(weighted, axis=1)
            integrals += (each - np.log(count)).tolist()
            k = int(np.argmax(each))
            if best is None or each[k] > best[0]:
                amplitude = float(priors.AMPLITUDES[int(np.argmax(weighted[k]))])
                component = Component(forms[k], amplitude, count)
                best = float(each[k]), component
        assert best is not None  # noqa: S101 (no family is empty)
        return Addition(log_sum(integrals), *best)

    def _form_count(self, family: Family) -> int:
        """Return the number of forms that could have been chosen from."""
        if family.forms[0].effect.line_frequency is None:
            return len(family.forms)
        return frequencies_told_apart(self.design.source.runs)

    def conditioned(
        self,
        components: Sequence[Component],
        generic: Sequence[CoefficientPrior] = (),
        *,
        thermometer: bool = True,
    ) -> ConditionedDesign:
        """Return the equations with nuisances and components integrated out.

        `generic`: generic regressors' coefficients are integrated out as well; `thermometer`:
        whether the thermometer's errors are.
        """
        nuisances = self._likeliest(components)
        integrated = [
            *(nuisances if thermometer else nuisances[1:]),
            *(c.prior for c in components),
            *generic,
        ]
        design = self.design
        normal, right = design.products([c for prior in integrated for c in prior.columns])
        return conditioned(normal, right, design.chi_square, self.rows, integrated)

    def log_evidence(self, components: Sequence[Component]) -> tuple[float, float]:
        """Return ln evidence, nuisances integrated, and Δχ² beside them."""
        each = [(ln + z, gain) for ln, (z, gain) in self._alternatives(components)]
        return log_sum([z for z, _ in each]), max(each)[1]

    def _alternatives(
        self, components: Sequence[Component]
    ) -> list[tuple[float, tuple[float, float]]]:
        return [(ln, self._joint(components, some)) for ln, some in self.nuisances]

    def _joint(
        self, components: Sequence[Component], nuisances: Sequence[CoefficientPrior]
    ) -> tuple[float, float]:
        together = [*nuisances, *(c.prior for c in components)]
        normal, right = self.design.equations([c for prior in together for c in prior.columns])
        return joint_evidence(normal, right, self.design.chi_square, self.rows, together)

    def evidence(self, components: Sequence[Component], name: str | None = None) -> float:
        """Return 2 ln of the Bayes factor of one effect in a set, or of the set."""
        left = [c for c in components if name is not None and c.name != name]
        return 2.0 * (self.log_evidence(components)[0] - self.log_evidence(left)[0])

    def speaks_for(self, components: Sequence[Component]) -> float:
        """Return ln of the Bayes factor of effects in their forms against no effect."""
        return self.log_evidence(components)[0] - self.nothing

    def needed_evidence(self, belief: float) -> float:
        """Return 2 ln of the Bayes factor that makes one effect, known in form, so probable."""
        odds = np.log(belief / (1.0 - belief)) + np.log(priors.NOTHING) - self.log_prior(1)
        return 2.0 * float(odds)

    def single(self, family: Family) -> EffectSet:
        """Return the best form of one family alone, with its posterior."""
        addition = self._addition(self.conditioned(()), family, priors.amplitude_log_prior(None))
        return self.fitted_set([addition.component])

    # Fit of a set: shapes and amplitudes of its components beside each other.

    def fitted_set(self, components: Sequence[Component]) -> EffectSet:
        """Return components fitted together, with the posterior of their set."""
        names = tuple(sorted(c.name for c in components))
        before = self._fits.get(names)
        if before is None:
            fitted = self._fitted(list(components), SHAPE_RATIOS)
            if len(components) > 1:
                fitted = self._fitted(fitted, SHAPE_RATIOS[1:])
        else:
            fitted = self._fitted(list(before), SHAPE_RATIOS[1:])
        self._fits[names] = tuple(fitted)
        return self._weighed(fitted, self.nothing)

    def _fitted(self, components: list[Component], ratios: Sequence[float]) -> list[Component]:
        """Return the components with their best shapes and amplitudes beside each other."""
        for place in range(len(components)):
            components = self._shaped(components, place, ratios)
            components = self.scaled(components, place)[0]
        return components

    def _shaped(
        self, components: list[Component], place: int, ratios: Sequence[float]
    ) -> list[Component]:
        """Move the shape parameters of one component while that explains more."""
        one = components[place]
        if one.form.free == 0:
            return components
        nuisances = self._likeliest(components)
        each_way = _unit_ways(one.form.free)
        known: dict[Effect, float] = {}

        def likely(form: Form) -> float:
            if form.effect not in known:
                some = self._with(components, place, form)
                known[form.effect] = self._joint(some, nuisances)[0]
            return known[form.effect]

        best = one.form
        with self.design.trials():
            for ratio in ratios:
                for _ in range(MOST_MOVES):
                    near = moved_forms(self.design, best, ratio, each_way)
                    inside = [form for form in near if form is not None]
                    nearest = max(inside, key=likely, default=best)
                    if likely(nearest) < likely(best) + LEAST_MOVE:
                        break
                    best = nearest
                values = [None if form is None else likely(form) for form in near]
                peak = moved_forms(self.design, best, ratio, [_peak(likely(best), values)])[0]
                if peak is not None and likely(peak) > likely(best):
                    best = peak
                if all(abs(v - likely(best)) < LEAST_MOVE for v in values if v is not None):
                    break  # a finer move changes nothing
        return self._with(components, place, form_of(self.design, best.effect, one.form.run))

    @staticmethod
    def _with(components: Sequence[Component], place: int, form: Form) -> list[Component]:
        """Return the components with one in another form."""
        changed = replace(components[place], form=form)
        return [*components[:place], changed, *components[place + 1 :]]

    def scaled(self, components: list[Component], place: int) -> tuple[list[Component], float]:
        """Return the components with one's best amplitude, and ln of the sum over amplitudes.

        The sum is relative to the evidence at the best one.
        """
        grid = priors.AMPLITUDES
        trials: dict[int, tuple[list[Component], float]] = {}
        nuisances = self._likeliest(components)

        def at(index: int) -> float:
            if index not in trials:
                one = replace(components[place], amplitude=float(grid[index]))
                some = [*components[:place], one, *components[place + 1 :]]
                trials[index] = some, self._joint(some, nuisances)[0]
            return trials[index][1]

        here = int(np.argmin(np.abs(np.log(grid / components[place].amplitude))))
        while True:
            near = [i for i in (here - 1, here, here + 1) if 0 <= i < len(grid)]
            best = max(near, key=at)
            if best == here:
                break
            here = best
        total = log_sum([value for _, value in trials.values()]) - at(here)
        return trials[here][0], total

    def _weighed(self, components: list[Component], nothing: float) -> EffectSet:
        """Return the set with its posterior: amplitudes and shapes integrated about their best."""
        occam = 0.0
        for place in range(len(components)):
            components, total = self.scaled(components, place)
            occam += total + self._shape_share(components, place)
        evidence, explained = self.log_evidence(components)
        explained -= self._explained_by_nuisances
        prior = self.log_prior(len(components)) + self._amplitudes_log_prior(components)
        return EffectSet(
            tuple(components),
            prior + evidence + occam - nothing,
            prior,
            max(explained, 0.0),
        )

    def _amplitudes_log_prior(self, components: Sequence[Component]) -> float:
        """Return ln of the prior of the amplitudes: the strongest free, the others beside it."""
        ordered = sorted((c.amplitude for c in components), reverse=True)
        total = float(priors.amplitude_log_prior(None)[0])
        for amplitude in ordered[1:]:
            beside = priors.amplitude_log_prior(ordered[0])
            total += float(np.interp(np.log(amplitude), np.log(priors.AMPLITUDES), beside))
        return total

    def _shape_share(self, components: list[Component], place: int) -> float:
        """Return ln of the share of the prior over shapes that the peak of the evidence takes."""
        one = components[place]
        share = -float(np.log(one.forms))
        if one.form.free == 0:
            return share
        nuisances = self._likeliest(components)
        here = self._joint(components, nuisances)[0]
        with self.design.trials():
            near = moved_forms(self.design, one.form, CURVATURE_RATIO, _unit_ways(one.form.free))
            moved = [self._with(components, place, f) for f in near if f]
            trials = [self._joint(some, nuisances)[0] for some in moved]
            drops = [max(here - trial, 1e-3) for trial in trials]
        if not drops:
            return share
        widths = np.log(CURVATURE_RATIO) * np.sqrt(np.pi / np.array(drops))
        wide = one.form.free * float(np.log(widths / priors.SHAPE_STEP_LN).mean())
        # A peak as wide as the grid or wider is what the sum over the grid is.
        return share + min(wide, float(np.log(one.forms)))

    def log_prior(self, effects: int) -> float:
        """Return ln of the prior of a set of so many effects, which are all equally likely."""
        more = priors.ANOTHER_EFFECT
        count = (1.0 - priors.NOTHING) * (1.0 - more) * more ** (effects - 1)
        orders = np.log(np.arange(1, effects + 1)).sum()
        families = len(self.families) + len(self.guesses)
        return float(np.log(count) + orders - effects * np.log(max(families, 1)))


def _with_a_trace(design: CandidateDesign, some: Sequence[Family]) -> list[Family]:
    """Return the families with a column that is more than rounding beside the base model."""
    normal = design.products(())[0]
    columns = [[c for form in f.forms for t in form.terms for c in t.columns] for f in some]
    return [f for f, own in zip(some, columns, strict=True) if (normal[:, own, own] > 0.0).any()]


def _unit_ways(parameters: int) -> list[list[float]]:
    """Return each parameter's way up and down alone."""
    return [
        [way * (other == one) for other in range(parameters)]
        for one in range(parameters)
        for way in (1.0, -1.0)
    ]


def _peak(here: float, near: Sequence[float | None]) -> list[float]:
    """Return where a parabola in each parameter has its peak, as powers of the ratio."""
    powers = []
    for up, down in zip(near[::2], near[1::2], strict=True):
        bend = 0.0 if up is None or down is None else 2.0 * here - up - down
        slope = 0.0 if up is None or down is None else up - down
        powers.append(float(np.clip(0.5 * slope / bend, -1.0, 1.0)) if bend > 0.0 else 0.0)
    return powers


def _alike(forms: Sequence[Form]) -> list[list[Form]]:
    """Return the forms in groups of as many columns."""
    groups: dict[int, list[Form]] = {}
    for form in forms:
        groups.setdefault(sum(len(term.columns) for term in form.terms), []).append(form)
    return list(groups.values())
