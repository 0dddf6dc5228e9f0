# SPDX-License-Identifier: Apache-2.0
"""Answer about one sensor: explanations with probabilities, and the one that is reported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

from thermal_comp.diagnosis.evidence.common_thermometer import like_the_thermometer
from thermal_comp.diagnosis.evidence.effect_sets import (
    NOT_IN_CATALOGUE,
    UNLOGGED,
    Component,
    EffectSet,
    Names,
)
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.diagnosis.evidence.posterior import Explanation, probability
from thermal_comp.diagnosis.evidence.set_fit import fitted_set
from thermal_comp.effects.effect import Effect, joined_effects
from thermal_comp.model.values import NoiseModel

MISSING_PROBABILITY = 0.85
"""Probability from which something is reported as missing: six missed effects cost as much as
one false alarm."""
FEWER_EFFECTS_ODDS = 0.5
"""Odds to the likeliest set from which one with an effect less is reported in its place."""
UNNAMED_CAUSES = {'unexplained': NOT_IN_CATALOGUE, 'unlogged': UNLOGGED}
"""Name that stands for an unnamed cause in an explanation, by kind of answer."""
Kind = Literal['complete', 'named', 'unexplained', 'unlogged']


@dataclass(frozen=True, eq=False)
class FoundElsewhere:
    """A coupled effect that another sensor named, and that acts on this one, too."""

    name: str
    probability: float
    otherwise: tuple[Explanation, ...]
    """Explanations of this sensor's residual without it."""


@dataclass(frozen=True, eq=False)
class SensorAnswer:
    """What explains one sensor's residual."""

    hypotheses: SensorHypotheses
    sets: tuple[EffectSet, ...]
    explanations: tuple[Explanation, ...]
    """Most probable first; their probabilities sum to 1."""
    offered: tuple[type[Effect], ...]
    """Effects of the catalogue that were tried in this sensor."""
    untried: frozenset[str]
    """Effects that were not, as a channel was not logged."""
    log_evidence: float
    """ln of the density of the rows under all explanations, of noise and model together."""
    usual_noise: NoiseModel | None = None
    """Noise that the sensor usually has; None where the fitted one is hardly louder."""
    elsewhere: FoundElsewhere | None = None
    """Coupled effect of another sensor, beside which the explanations were found."""

    @property
    def with_coupled(self) -> tuple[Explanation, ...]:
        """The explanations, with the coupled effect among the names, most probable first."""
        if self.elsewhere is None:
            return self.explanations
        effect, acts = self.elsewhere.name, self.elsewhere.probability
        parts = [
            replace(e, names=_with_name(e.names, effect), probability=acts * e.probability)
            for e in self.explanations
        ]
        parts += [
            replace(e, probability=(1.0 - acts) * e.probability) for e in self.elsewhere.otherwise
        ]
        found: dict[Names, Explanation] = {}
        for one in parts:
            first = found.get(one.names, replace(one, probability=0.0))
            found[one.names] = replace(first, probability=first.probability + one.probability)
        return tuple(sorted(found.values(), key=lambda e: -e.probability))

    def evidence(self, name: str | None = None) -> float:
        """Return 2 ln of the Bayes factor of an effect in the likeliest set, or of the whole."""
        return self.hypotheses.evidence(self.likeliest.components, name)

    @property
    def needed_evidence(self) -> float:
        """2 ln of the Bayes factor from which something is reported as missing."""
        return self.hypotheses.needed_evidence(MISSING_PROBABILITY)

    @property
    def kind(self) -> Kind:
        """Kind of the answer: complete, unless it is highly probable that something is missing."""
        missing = 1.0 - probability(self.explanations, lambda e: e.names == ())
        if missing < MISSING_PROBABILITY:
            return 'complete'
        unknown, unlogged = map(self.probability_of, (NOT_IN_CATALOGUE, UNLOGGED))
        if unknown + unlogged > missing - unknown - unlogged:
            return 'unexplained' if unknown >= unlogged else 'unlogged'
        return 'named'

    @property
    def likeliest(self) -> Explanation:
        """The most probable explanation of that kind, without effects whose probability is low."""
        kind = self.kind
        if kind == 'complete':
            return next(e for e in self.explanations if e.names == ())
        if kind in UNNAMED_CAUSES:
            return next(e for e in self.explanations if UNNAMED_CAUSES[kind] in e.names)
        named = [
            e for e in self.explanations if e.names and not {*UNNAMED_CAUSES.values()} & {*e.names}
        ]
        said = named[0]
        while fewer := next((e for e in named if _one_fewer(e, said)), None):
            said = fewer
        return said

    @property
    def named(self) -> tuple[Effect, ...]:
        """The effects that are named, in the form found; also those beside an unexplained part."""
        likeliest, every = self.likeliest, self.kind == 'named'
        return tuple(
            c.form.effect
            for c in likeliest.components
            if every
            or (c.name in likeliest.names and self.probability_of(c.name) > MISSING_PROBABILITY)
        )

    def probability_of(self, name: str) -> float:
        """Return the probability that a set of this name acts, an effect or an unnamed cause."""
        return probability(self.explanations, lambda e: name in e.names)

    def set_of(self, components: Sequence[Component]) -> EffectSet:
        """Return the set of some components, with its posterior."""
        names = tuple(sorted(c.name for c in components))
        known = (s for s in self.sets if s.names == names)
        return next(known, None) or fitted_set(self.hypotheses, components)

    @cached_property
    def closest(self) -> tuple[Effect, ...]:
        """Effects most like an unexplained residual; () where one is named.

        With them, the effect that the thermometer's own errors look like, where these explain
        more, and where nothing is missing.
        """
        if self.kind == 'named':
            return ()
        best = max(self.sets, key=lambda s: s.log_posterior)
        components = () if self.kind == 'complete' else best.components
        effects = (c.form.effect for c in components)
        likest = tuple(effect for effect in effects if not effect.guessed_channel)
        if components and best.explained > self.hypotheses.explained_by_thermometer:
            return likest
        return joined_effects([*likest, *like_the_thermometer(self.hypotheses, self.sets)])


def _with_name(names: Names, name: str) -> Names:
    """Return the names of a set with one effect more; what has no name stands last."""
    unnamed = {*UNNAMED_CAUSES.values()}
    known = sorted([*(n for n in names if n not in unnamed), name])
    return (*known, *(n for n in names if n in unnamed))


def _one_fewer(fewer: Explanation, said: Explanation) -> bool:
    """Tell whether an explanation has one effect fewer than `said` and is not much less likely."""
    less = set(fewer.names) < set(said.names) and len(fewer.names) == len(said.names) - 1
    return less and fewer.probability > FEWER_EFFECTS_ODDS * said.probability
