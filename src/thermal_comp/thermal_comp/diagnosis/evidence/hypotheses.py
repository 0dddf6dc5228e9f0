# SPDX-License-Identifier: Apache-2.0
"""Evidence of sets of effects for one sensor's residual, nuisances integrated."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.candidates import (
    Family,
    channels_not_logged,
    families,
    guesses,
)
from thermal_comp.diagnosis.evidence.effect_sets import NO_EFFECT, Component, EffectSet, Names
from thermal_comp.diagnosis.evidence.felt_errors import FeltErrors, felt_errors
from thermal_comp.diagnosis.evidence.generic_regressors import (
    GenericRegressor,
    all_variables,
    generic_regressors,
    lost_over_time,
)
from thermal_comp.diagnosis.evidence.nuisances import Response, errors_by_slope, nuisance_priors
from thermal_comp.diagnosis.evidence.temperature_course import TemperatureSlope
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnGroup
from thermal_comp.linear.gaussian_evidence import (
    CoefficientPrior,
    ConditionedDesign,
    conditioned,
    joint_evidence,
    log_sum,
)

MOST_THERMOMETER_CHI2 = 20.0
"""χ² of its errors by their prior up to which a thermometer is taken to have made them: those of
lagging ones have 6 and less, what is bent into them to follow a curvature of the sensor 40."""
LARGEST_THERMOMETER_FLAW = 0.1
"""Rms of what the thermometer's errors leave beyond noise, over their own, up to which it is their
flaw. Then they may have any size: no model of a lag of sixty times the noise is exact."""


class SensorHypotheses:
    """One sensor's residual with all that may explain it: effects, nuisances, regressors."""

    def __init__(
        self,
        design: CandidateDesign,
        catalogue: Mapping[str, type[Effect]],
        response: Response | None = None,
        known: EffectSet = NO_EFFECT,
    ) -> None:
        """`response`: what an error of the temperature does, where a model tells.

        `known`: effects of the base model. Further ones are as likely beside them as in a set with
        them, and their equations may have a flaw.
        """
        self.design = design
        self.known = known
        response = response or TemperatureSlope.of(design).response
        self._by_slope = errors_by_slope(design, response)
        """By run, what errors of the thermometer do."""
        errors = [(lambda run: self._by_slope[run.name], False)]
        self.thermometer = design.generic_terms(errors, runs=design.source.smoothed)[0]
        """Columns of what an error of the thermometer does."""
        self.nuisances = nuisance_priors(design, self.thermometer, response)
        self._told = 0.0
        """χ² of what other sensors tell of the thermometer …"""
        count = len(self.thermometer.columns)
        self._told_equations = np.zeros((count, count)), np.zeros(count)
        """… and their normal equations."""
        self.families = _visible(design, families(design, catalogue))
        self.guesses = _visible(design, guesses(design, catalogue))
        """Effects of channels that were not logged but can be guessed."""
        self.without_channel = channels_not_logged(design, catalogue)
        """Effects that could act unseen, each with the channel that was not logged."""
        self.regressors: list[GenericRegressor] = []
        """Flexible functions of one variable each; none before `allow_unnamed`."""
        self.discrepancy = ColumnGroup(())
        """A smooth function of all that was logged, for what equations lack; likewise."""
        self._acting = {**EFFECTS, **catalogue}
        """Effects whose channels act on sensors, offered or not."""
        self.lost_over_time = lost_over_time(design, self._acting)
        """Lost channel that may have any course over time; '' where none is."""
        self.unseen: dict[Names, dict[str, float]] = {}
        """Set → effect more → odds of it against none, where it would be too small to be seen."""
        self.rows = 3 * design.rows - design.base_rank
        self.fits: dict[Names, tuple[Component, ...]] = {}
        """Sets as they were fitted last: where a search begins anew, fits go on from there."""
        self._likely: dict[Hashable, list[float]] = {}
        """Components → ln of prior times evidence of each alternative of the nuisances."""
        self._felt: dict[Hashable, FeltErrors] = {}
        """Components → what they make of errors of the temperature."""
        self._weigh_nuisances()

    def allow_unnamed(self) -> None:
        """Compute the columns of explanations without a named effect: regressors, discrepancy."""
        if not self.regressors:
            self.regressors = generic_regressors(self.design, self._acting)
            self.discrepancy = all_variables(self.design, self.regressors)

    def inform(self, normal: FloatArray, right: FloatArray) -> None:
        """Add other sensors' normal equations (p, p) and (p,) of the thermometer's errors."""
        self._told += self.design.inform(self.thermometer, normal, right)
        before, before_right = self._told_equations
        self._told_equations = before + normal, before_right + right
        self._weigh_nuisances()

    def _weigh_nuisances(self) -> None:
        self._likely.clear()
        self._felt.clear()
        likeliest = self.likeliest_nuisances(())
        self.nothing = self.log_evidence(())
        alone = self.joint((), likeliest[:1])[1]
        left = self.design.chi_square - alone - self.rows
        follows = alone > self.rows and left < LARGEST_THERMOMETER_FLAW**2 * alone
        plausible = follows or self._prior_chi2(likeliest[0]) <= MOST_THERMOMETER_CHI2
        self.explained_by_thermometer = max(alone - self._told, 0.0) if plausible else 0.0
        """Δχ² of the thermometer's errors alone; 0 where they are too large to be one's."""

    def likeliest_alternative(
        self, components: Sequence[Component]
    ) -> tuple[float, Sequence[CoefficientPrior]]:
        """Return the alternative of the nuisances that is likeliest beside components, ln first.

        Slow noise seen beside no effect may be what a large effect has done.
        """
        return self.nuisances[int(np.argmax(self._log_posteriors(components)))]

    def _log_posteriors(self, components: Sequence[Component]) -> list[float]:
        """Return ln of prior times evidence of each alternative of the nuisances."""
        key = _key(components)
        if key not in self._likely:
            self._likely[key] = [ln + z for ln, (z, _) in self._alternatives(components)]
        return self._likely[key]

    def likeliest_nuisances(self, components: Sequence[Component]) -> Sequence[CoefficientPrior]:
        """Return the nuisances that are likeliest beside components."""
        return self.likeliest_alternative(components)[1]

    def with_less_noise(
        self, components: Sequence[Component]
    ) -> Iterator[tuple[float, Sequence[CoefficientPrior]]]:
        """Yield the likeliest alternative of the nuisances, then those with less slow noise.

        Of each amount of it the likeliest one; ln of the prior first.
        """
        felt = self._felt_by(components)
        likely = self._with_felt(components, felt) if felt else self._log_posteriors(components)
        ranked = [self.nuisances[k] for k in np.argsort(likely)[::-1]]
        yield ranked[0]
        loudest = _noise_power(ranked[0][1])
        looked_at: set[float] = set()
        for ln, some in ranked[1:]:
            power = _noise_power(some)
            if power < loudest and power not in looked_at:
                looked_at.add(power)
                yield ln, some

    def _prior_chi2(self, thermometer: CoefficientPrior) -> float:
        """Return χ² of the thermometer's errors by their prior, those that explain most."""
        normal, right = self.design.equations(thermometer.columns)
        deviation = thermometer.deviation
        scaled = normal.sum(axis=0) * np.outer(deviation, deviation)
        errors = np.linalg.solve(np.eye(len(deviation)) + scaled, deviation * right.sum(axis=0))
        return float(errors @ errors)

    def conditioned(
        self,
        components: Sequence[Component],
        generic: Sequence[CoefficientPrior] = (),
        *,
        thermometer: bool = True,
        further: Sequence[Component] = (),
        nuisances: Sequence[CoefficientPrior] | None = None,
    ) -> ConditionedDesign:
        """Return the equations with nuisances and components integrated out.

        `generic`: generic regressors' coefficients are integrated out as well; `thermometer`:
        whether the thermometer's errors are. Nuisances are those given, or those likeliest beside
        the components and `further` ones.
        """
        felt = self._felt_by(components)
        together = (*components, *further)
        if nuisances is None:
            nuisances = self.likeliest_nuisances(together)
            if felt:
                each = self._with_felt(together, felt)
                nuisances = self.nuisances[int(np.argmax(each))][1]
        if felt:
            nuisances = self._beside(felt, nuisances)
        integrated = [
            *(nuisances if thermometer else nuisances[1:]),
            *(c.prior for c in components),
            *generic,
        ]
        design = self.design
        normal, right = design.products([c for prior in integrated for c in prior.columns])
        return conditioned(normal, right, design.chi_square, self.rows, integrated)

    def log_odds_of_felt_errors(self, components: Sequence[Component]) -> float:
        """Return ln of the odds that the temperature was another one, as components feel it.

        It is what they gain in evidence by errors of the temperature; 0 where they feel none.
        """
        with self.design.trials():
            felt = self._felt_errors(components)
            if not felt:
                return 0.0
            return log_sum(self._with_felt(components, felt)) - self.log_evidence(components)

    def _felt_by(self, components: Sequence[Component]) -> FeltErrors:
        """Return what components make of errors of the temperature, computed once."""
        key = _key(components)
        if key not in self._felt:
            self._felt[key] = self._felt_errors(components)
        return self._felt[key]

    def _felt_errors(self, components: Sequence[Component]) -> FeltErrors:
        """Return what components make of errors of the temperature, and what others tell of it."""
        likeliest = self.likeliest_nuisances(components)
        felt = felt_errors(self.design, components, likeliest, self._by_slope)
        if felt.thermometer.columns and self._told:
            self.design.inform(felt.thermometer, *self._told_equations, counted=False)
        return felt

    def _with_felt(self, components: Sequence[Component], felt: FeltErrors) -> list[float]:
        """Return ln of prior times evidence of each alternative beside errors that are felt."""
        return [
            ln + self.joint(components, self._beside(felt, some))[0] for ln, some in self.nuisances
        ]

    def _beside(
        self, felt: FeltErrors, nuisances: Sequence[CoefficientPrior]
    ) -> list[CoefficientPrior]:
        """Return one alternative of the nuisances with errors that are felt."""
        size = np.maximum(self.design.size_of(self.thermometer), 1e-300)
        return felt.beside(nuisances, nuisances[0].deviation / size)

    def log_evidence(self, components: Sequence[Component]) -> float:
        """Return ln evidence, nuisances integrated."""
        return log_sum(self._log_posteriors(components))

    def explained(
        self, components: Sequence[Component], others: Sequence[Component] | None = None
    ) -> float:
        """Return Δχ² of components beside the slow noise that is likeliest with them, or `others`.

        Beside no effect louder noise is likelier, which explains what they do. The thermometer
        lags little, as most do: one that lags much explains most of what a rate does.
        """
        slow = self.likeliest_nuisances(components if others is None else others)[1:]
        nuisances = [self.nuisances[0][1][0], *slow]
        return max(self.joint(components, nuisances)[1] - self.joint((), nuisances)[1], 0.0)

    def _alternatives(
        self, components: Sequence[Component]
    ) -> list[tuple[float, tuple[float, float]]]:
        return [(ln, self.joint(components, some)) for ln, some in self.nuisances]

    def joint(
        self, components: Sequence[Component], nuisances: Sequence[CoefficientPrior]
    ) -> tuple[float, float]:
        """Return ln evidence and Δχ² of components beside one alternative of the nuisances."""
        together = [*nuisances, *(c.prior for c in components)]
        known = self.design.products_among([c for prior in together for c in prior.columns])
        return joint_evidence(*known, self.design.chi_square, self.rows, together)

    def evidence(self, components: Sequence[Component], name: str | None = None) -> float:
        """Return 2 ln of the Bayes factor of one effect in a set, or of the set."""
        left = [c for c in components if name is not None and c.name != name]
        return 2.0 * (self.log_evidence(components) - self.log_evidence(left))

    def log_bayes_factor(self, components: Sequence[Component]) -> float:
        """Return ln of the Bayes factor of effects in their forms against no effect."""
        return self.log_evidence(components) - self.nothing

    def needed_evidence(self, belief: float) -> float:
        """Return 2 ln of the Bayes factor that makes one effect, known in form, so probable."""
        odds = np.log(belief / (1.0 - belief)) + self.log_prior(0) - self.log_prior(1)
        return 2.0 * float(odds)

    def log_odds_of_twin(self, components: Sequence[Component], share: float) -> float:
        """Return ln of the odds that the flaws of two twins make up a share of what one explains.

        A thermometer that lags by t shows T where T + t dT/dt is true, so that a rate changes by
        t d²T/dt²: each alternative of its lag beside the components has its share of the odds.
        """
        rate, bend = np.maximum(self.design.size_of(self.thermometer)[:2], 1e-300)
        each = [ln + self.joint(components, some)[0] for ln, some in self.nuisances]
        lags = [some[0].deviation[0] / rate for _, some in self.nuisances]
        odds = [priors.log_odds_of_twin(share, float(lag * bend / rate)) for lag in lags]
        return log_sum(np.add(each, odds)) - log_sum(each)

    def twins_of(self, effect: Effect) -> list[str]:
        """Return the names of what has nearly the columns of an effect: its twin, or a guess."""
        if not effect.twin:
            return []
        return [effect.twin, *(g.name for g in self.guesses if g.effect.twin == effect.name)]

    def log_prior(self, effects: int) -> float:
        """Return ln of the prior of a set of so many effects, which are all equally likely."""
        more = priors.ANOTHER_EFFECT_PROBABILITY
        any_effect = more if self.known.components else 1.0 - priors.NOTHING_PROBABILITY
        count = any_effect * (1.0 - more) * more ** (effects - 1) if effects else 1.0 - any_effect
        orders = np.log(np.arange(1, effects + 1)).sum()
        families = len(self.families) + len(self.guesses)
        return float(np.log(count) + orders - effects * np.log(max(families, 1)))


def _key(components: Sequence[Component]) -> Hashable:
    """Return what tells components apart."""
    return tuple((c.form.effect, c.form.run, c.amplitude) for c in components)


def _noise_power(nuisances: Sequence[CoefficientPrior]) -> float:
    """Return the variance [Δχ²] of all but the thermometer's errors, which come first.

    Alternatives differ in it by their slow noise alone.
    """
    return float(sum((prior.deviation**2).sum() for prior in nuisances[1:]))


def _visible(design: CandidateDesign, some: Sequence[Family]) -> list[Family]:
    """Return the families with a column that is more than rounding beside the base model."""
    normal = design.products(())[0]
    columns = [[c for form in family.forms for c in form.columns] for family in some]
    return [f for f, own in zip(some, columns, strict=True) if (normal[:, own, own] > 0.0).any()]
