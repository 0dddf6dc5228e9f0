# SPDX-License-Identifier: Apache-2.0
"""What explains the residual of each sensor, alone and where several sensors feel an effect."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.blocks import in_search_blocks
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.spectral_lines import spectral_lines
from thermal_comp.diagnosis.evidence.candidates import missing_channels
from thermal_comp.diagnosis.evidence.common_thermometer import like_the_thermometer, told_by_others
from thermal_comp.diagnosis.evidence.effect_sets import (
    NOT_IN_CATALOGUE,
    UNLOGGED,
    Component,
    EffectSet,
    Names,
)
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.diagnosis.evidence.posterior import Explanation, explanations, probability
from thermal_comp.diagnosis.noise_level import NoiseReference
from thermal_comp.effects.effect import Effect, joined_effects
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.linear.gaussian_evidence import ConditionedDesign, log_evidence
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.estimation import fit_noise
from thermal_comp.noise.of_runs import (
    independent_axes,
    log_prior_of_loudness,
    noise_beside,
    turned_runs,
    usual_noise,
)

BELIEVED = 0.85
"""Probability that something is missing from which it is said: a false word costs six missed."""
DISPENSABLE = 0.5
"""Odds from which a set that does with one effect less is said in place of the likeliest."""
SURE_OF_NOTHING = 0.95
"""Probability that a sensor lacks nothing from which it need not be asked again."""
TOLD_DIFFERENCE = 0.5
"""Difference of ln evidence between sets that what others tell has to make …"""
COMPARED_SETS = 5
"""… among so many of the likeliest."""
REFUTING_CHI2 = 20.0
"""χ² against an effect of several sensors from which no flaw in its form excuses it …"""
REFUTING_SHARE = 2e-4
"""… or this share of what it explains: the larger it is, the more a flaw in its form costs."""
CHANGED_VARIANCE_SHARE = 0.8
"""Share of its variance below which noise is another one."""
SHARE_BEFORE, SHARE_OF_SEARCH = 0.1, 0.75
"""Share of a diagnosis that is done before its sensors are searched, and after them."""
Listed = dict[Sensor, tuple[Effect, ...]]
UNNAMED = {'unexplained': NOT_IN_CATALOGUE, 'unlogged': UNLOGGED}
"""By kind of answer, what stands among the names of an explanation by something without one."""
Kind = Literal['complete', 'named', 'unexplained', 'unlogged']


def no_progress(_text: str, _share: float) -> None:
    """Take a report of progress and do nothing: the default."""


@dataclass(frozen=True, eq=False)
class Settings:
    """What a diagnosis is made with."""

    catalogue: Mapping[str, type[Effect]]
    reference: NoiseReference | None = None
    """Noise that counts as normal; None: that of the shipped chip."""
    bandwidth_known: bool = False
    """Whether the density of white noise is that of the sensor."""
    progress: Callable[[str, float], None] = no_progress
    """Called with what is being done and the share of all that is done."""


@dataclass(frozen=True, eq=False)
class FoundElsewhere:
    """A coupled effect that another sensor named, and that acts on this one, too."""

    name: str
    probability: float
    otherwise: tuple[Explanation, ...]
    """What explains this sensor's residual where it does not act."""


@dataclass(frozen=True, eq=False)
class SensorAnswer:
    """What explains one sensor's residual."""

    hypotheses: SensorHypotheses
    sets: tuple[EffectSet, ...]
    explanations: tuple[Explanation, ...]
    """Most probable first; their probabilities sum to 1."""
    offered: tuple[type[Effect], ...]
    """Effects of the catalogue that were looked for in this sensor …"""
    untried: frozenset[str]
    """… and those whose channel was not logged."""
    log_evidence: float
    """ln of the density of the rows under all explanations, of noise and model together."""
    elsewhere: FoundElsewhere | None = None
    """The coupled effect beside which all this was found."""

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
        """2 ln of the Bayes factor from which an effect is likelier than not to be believed."""
        return self.hypotheses.needed_evidence(BELIEVED)

    @property
    def kind(self) -> Kind:
        """Kind of the answer: complete, unless it is highly probable that something is missing."""
        missing = 1.0 - probability(self.explanations, lambda e: e.names == ())
        if missing < BELIEVED:
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
        if kind in UNNAMED:
            return next(e for e in self.explanations if UNNAMED[kind] in e.names)
        named = [e for e in self.explanations if e.names and not {*UNNAMED.values()} & {*e.names}]
        said = named[0]
        while fewer := next((e for e in named if _one_fewer(e, said)), None):
            said = fewer
        return said

    @property
    def named(self) -> tuple[Effect, ...]:
        """The effects that are named, in the form found; also beside what has no name."""
        likeliest, every = self.likeliest, self.kind == 'named'
        return tuple(
            c.form.effect
            for c in likeliest.components
            if every or (c.name in likeliest.names and self.probability_of(c.name) > BELIEVED)
        )

    def probability_of(self, name: str) -> float:
        """Return the probability that an effect acts, or what has no name: of all its parts."""
        return probability(self.explanations, lambda e: name in e.names)

    def set_of(self, components: Sequence[Component]) -> EffectSet:
        """Return the set of some components, with its posterior."""
        names = tuple(sorted(c.name for c in components))
        known = (s for s in self.sets if s.names == names)
        return next(known, None) or self.hypotheses.fitted_set(components)

    @cached_property
    def closest(self) -> tuple[Effect, ...]:
        """The effects that come closest where something acts that has no name; () elsewhere.

        That may be the thermometer itself: where nothing else is missing, what its errors look
        like.
        """
        if self.kind == 'named':
            return ()
        if self.kind == 'complete':
            return like_the_thermometer(self.hypotheses, self.sets)
        best = max(self.sets, key=lambda s: s.log_posterior)
        effects = (c.form.effect for c in best.components)
        return tuple(effect for effect in effects if not effect.guessed_channel)


def _with_name(names: Names, name: str) -> Names:
    """Return the names of a set with one effect more; what has no name stands last."""
    unnamed = {*UNNAMED.values()}
    known = sorted([*(n for n in names if n not in unnamed), name])
    return (*known, *(n for n in names if n in unnamed))


def _one_fewer(fewer: Explanation, said: Explanation) -> bool:
    """Tell whether an explanation has one effect fewer than `said` and is not much less likely."""
    less = set(fewer.names) < set(said.names) and len(fewer.names) == len(said.names) - 1
    return less and fewer.probability > DISPENSABLE * said.probability


def search_sensors(
    runs: Sequence[PreparedRun],
    base: Listed,
    noise: Mapping[Sensor, NoiseModel],
    settings: Settings,
) -> dict[Sensor, SensorAnswer]:
    """Return what explains each sensor's residual, by itself, then where effects are coupled."""
    lines = {sensor: spectral_lines(runs, sensor) for sensor in base}
    searched = in_search_blocks(runs, [line for some in lines.values() for line in some])
    searches = SensorSearches(ColumnSource(searched, lines), base, noise, settings)
    found = {}
    for number, sensor in enumerate(base):
        settings.progress(
            f'asking every effect about the {sensor}',
            SHARE_BEFORE + (SHARE_OF_SEARCH - SHARE_BEFORE) * number / len(base),
        )
        found[sensor] = searches.of_sensor(sensor)
    settings.progress('comparing what is left of the sensors', SHARE_OF_SEARCH)
    found |= searches.with_one_thermometer(found)
    for effect in settings.catalogue.values():
        if effect.coupled:
            found.update(searches.of_coupled(effect, found))
    return found


@dataclass(frozen=True, eq=False)
class SensorSearches:
    """The searches over the sensors of a campaign, which share the columns of effects."""

    source: ColumnSource
    base: Listed
    noise: Mapping[Sensor, NoiseModel]
    settings: Settings

    def of_sensor(self, sensor: Sensor, known: Sequence[Effect] = ()) -> SensorAnswer:
        """Return the answer about one sensor; `known` effects stand beside the base.

        Noise that is louder than usual may be an effect: with the usual noise it is asked again,
        and the likelier of the two stands. What is named, or comes closest where nothing is, and
        had been taken for noise (a step, a line) has the search begin anew, with the noise beside
        it.
        """
        beside = (*self.base[sensor], *known)
        axes = independent_axes(self.source.runs, sensor)
        runs = turned_runs(self.source.runs, sensor, axes)
        before = self.noise[sensor] if axes is None else fit_noise(runs, sensor, beside)
        found = self._under(before, sensor, beside, axes)
        usual = usual_noise(runs, sensor, before)
        if usual is not None:
            other = self._under(usual, sensor, beside, axes)
            loudness = log_prior_of_loudness(before, usual, runs[0].period)
            if other.log_evidence > found.log_evidence + loudness:
                found, before = other, usual
        likely = {sensor: joined_effects([*beside, *found.named, *found.closest])}
        noise = noise_beside(runs, likely, {sensor: before})[sensor]
        if _differs(noise, before, runs[0].period):
            found = self._under(noise, sensor, beside, axes)
        return found

    def with_one_thermometer(
        self, found: Mapping[Sensor, SensorAnswer]
    ) -> dict[Sensor, SensorAnswer]:
        """Return what changes where the others tell of the thermometer's errors.

        A sensor that lacks something without a name tells nothing. One that lacks nothing is not
        asked again, nor one to whose likeliest sets it makes no difference.
        """
        understood = {s for s, a in found.items() if a.kind not in UNNAMED}
        told = told_by_others({s: (a.hypotheses, a.sets) for s, a in found.items()}, understood)
        again = {}
        for sensor, answer in found.items():
            nothing = probability(answer.explanations, lambda e: e.names == ())
            if sensor in told and nothing < SURE_OF_NOTHING:
                hypotheses, likeliest = answer.hypotheses, answer.sets[:COMPARED_SETS]
                before = [hypotheses.speaks_for(s.components) for s in likeliest]
                hypotheses.inform(told[sensor].normal, told[sensor].right)
                after = [hypotheses.speaks_for(s.components) for s in likeliest]
                if np.ptp(np.subtract(after, before)) > TOLD_DIFFERENCE:
                    again[sensor] = self._answer(hypotheses, hypotheses.sets())
                else:  # the equations as they were, to which the answer belongs
                    hypotheses.inform(-told[sensor].normal, -told[sensor].right)
        return again

    def of_coupled(
        self, effect: type[Effect], found: Mapping[Sensor, SensorAnswer]
    ) -> dict[Sensor, SensorAnswer]:
        """Return what changes where several sensors feel an effect with the same coefficients.

        A fixture that tilts turns gravity and field alike. Such an effect is looked for in its
        first sensor; where that may have found it the others are asked, and if it is named then,
        they are searched with it as known.
        """
        asked = [sensor for sensor in effect.sensors if sensor in found]
        if len(asked) < 2 or not any(
            effect.name in e.names and e.probability > 1e-4 for e in found[asked[0]].explanations
        ):
            return {}
        first, *others = asked
        alone = found[first].probability_of(effect.name)
        if alone < 0.5 and any(found[s].kind in UNNAMED for s in others):
            # What has no name in another sensor is no sign of an effect this one hardly feels.
            return {}
        support = coupled_support(effect(), [found[sensor] for sensor in asked])
        sets = [s for s in found[first].sets if effect.name not in s.names]
        if support > -np.inf:
            # It speaks for the effect itself, not for what looks like it in the first sensor.
            sets += [
                replace(
                    s,
                    log_prior=s.log_prior + support,
                    log_posterior=s.log_posterior + support,
                )
                for s in with_effect(effect.name, found[first])
            ]
        again = {first: self._answer(found[first].hypotheses, sets)}
        forms = [form for form in again[first].named if form.name == effect.name]
        certain = again[first].probability_of(effect.name)
        for sensor in others if forms else ():
            elsewhere = FoundElsewhere(effect.name, certain, found[sensor].explanations)
            again[sensor] = replace(self.of_sensor(sensor, forms), elsewhere=elsewhere)
        return again

    def _under(
        self,
        noise: NoiseModel,
        sensor: Sensor,
        known: Sequence[Effect],
        axes: FloatArray | None,
    ) -> SensorAnswer:
        """Return the answer about one sensor under a given noise, independent along `axes`."""
        design = CandidateDesign(self.source, sensor, noise, known, axes=axes)
        hypotheses = self.hypotheses(design, known)
        return self._answer(hypotheses, hypotheses.sets())

    def _answer(self, hypotheses: SensorHypotheses, sets: Sequence[EffectSet]) -> SensorAnswer:
        ranked = sorted(sets, key=lambda s: -s.log_posterior)
        catalogue = self.settings.catalogue
        found, evidence = explanations(hypotheses, ranked)
        return SensorAnswer(
            hypotheses,
            tuple(ranked),
            tuple(found),
            tuple(family.effect for family in hypotheses.families),
            frozenset(catalogue) & frozenset(greyed_out(self.source.runs, catalogue)),
            hypotheses.nothing + evidence + hypotheses.design.log_density,
        )

    def hypotheses(self, design: CandidateDesign, known: Sequence[Effect]) -> SensorHypotheses:
        """Return the hypotheses about one sensor beside known effects."""
        once = {effect.name for effect in known if not effect.repeatable}
        offered = {
            name: effect
            for name, effect in self.settings.catalogue.items()
            if name not in once
            and not (effect.coupled and design.sensor != effect.sensors[0] and len(self.base) > 1)
        }
        return SensorHypotheses(design, offered)


def with_effect(name: str, answer: SensorAnswer) -> list[EffectSet]:
    """Return the sets of a sensor with an effect, and the likeliest others with it added.

    Alone it may explain little, and was then not looked for beside others.
    """
    sets = [s for s in answer.sets if name in s.names]
    component = next(c for s in sets for c in s.components if c.name == name)
    known = {s.names for s in sets}
    for some in answer.sets[:COMPARED_SETS]:
        larger = (*some.components, component)
        names = tuple(sorted(c.name for c in larger))
        if name not in some.names and names not in known:
            sets.append(answer.hypotheses.fitted_set(larger))
    return sets


def coupled_support(effect: Effect, searched: Sequence[SensorAnswer]) -> float:
    """Return ln of what other sensors add to the odds of an effect of the first; −∞: refuted.

    One set of coefficients, fitted to all sensors beside what else was named, explains less than
    the first alone would like where the others do not feel it: a scale factor that is equal on
    all axes is a tilt to the accelerometer in three orientations, but not to the magnetometer.
    The prior of the coefficients is as wide as in the first sensor: what it does not tell, the
    others have to pay for. It stands in the place of what is kindred to it in the others, or
    beside that: a field of the chamber that turns with the device hides how a tilt turns it.
    """
    deviation = _coefficient_deviation(effect, searched[0])
    first = _Share.of(effect, searched[0], _beside_coupled(effect, searched[0]))
    alone = first.coefficients([first], deviation)
    supports = []
    for beside_kin in (False, True):
        others = [
            _Share.of(effect, answer, _beside_coupled(effect, answer, with_kin=beside_kin))
            for answer in searched[1:]
        ]
        every = [first, *others]
        together = first.coefficients(every, deviation)
        support = sum(one.log_gain(together) + one.log_odds for one in others)
        support += first.log_gain(together) - first.log_gain(alone)
        support += _log_prior(together, every, deviation) - _log_prior(alone, [first], deviation)
        supports.append(support)
    best = max(supports)
    refuted = -0.5 * max(REFUTING_CHI2, REFUTING_SHARE * first.explained)
    return best if best > refuted else -np.inf


@dataclass(frozen=True, eq=False)
class _Share:
    """What one sensor tells of the coefficients of a coupled effect beside its own effects."""

    state: ConditionedDesign
    normal: FloatArray
    """(p, p) normal matrix …"""
    right: FloatArray
    """… and (p,) right-hand side of the coefficients, in their own units."""
    log_odds: float
    """ln of the odds of those own effects against what is said of the sensor."""

    @classmethod
    def of(cls, effect: Effect, answer: SensorAnswer, beside: Sequence[Component]) -> _Share:
        """Return what a sensor tells beside given components."""
        hypotheses = answer.hypotheses
        term = hypotheses.design.term(effect)
        state = hypotheses.conditioned(beside)
        size = hypotheses.design.size_of(term)
        normal, right = state.shared_equations(term.columns)
        weights = [
            answer.set_of(components).log_posterior
            for components in (beside, answer.likeliest.components)
        ]
        return cls(state, normal * np.outer(size, size), right * size, weights[0] - weights[1])

    @staticmethod
    def coefficients(shares: Sequence[_Share], deviation: float) -> FloatArray:
        """Return (p,) the likeliest coefficients, by all that is told and their prior."""
        normal = np.sum([one.normal for one in shares], axis=0)
        right = np.sum([one.right for one in shares], axis=0)
        inner = np.eye(len(right)) + deviation**2 * normal
        return np.asarray(deviation**2 * np.linalg.solve(inner, right))

    def log_gain(self, coefficients: FloatArray) -> float:
        """Return ln of the evidence that given coefficients add."""
        less = coefficients @ (2.0 * self.right - self.normal @ coefficients)
        state = self.state
        left = state.chi_square - float(less)
        after = log_evidence(left, state.log_determinant, state.rows)
        return float(after - state.log_evidence)

    @property
    def explained(self) -> float:
        """Δχ² of the coefficients that this sensor alone would like."""
        inverse = np.linalg.pinv(self.normal, rcond=1e-9, hermitian=True)
        return float(self.right @ inverse @ self.right)


def _log_prior(coefficients: FloatArray, shares: Sequence[_Share], deviation: float) -> float:
    """Return ln of the share of the prior that the coefficients and what is near them take."""
    normal = np.sum([one.normal for one in shares], axis=0)
    inner = np.eye(len(coefficients)) + deviation**2 * normal
    away = float(coefficients @ coefficients) / deviation**2
    return -0.5 * (away + float(np.linalg.slogdet(inner)[1]))


def _beside_coupled(
    effect: Effect, answer: SensorAnswer, *, with_kin: bool = False
) -> list[Component]:
    """Return what stands beside a coupled effect in a sensor, `with_kin`: kindred ones, too."""
    with_it = next((s for s in answer.sets if effect.name in s.names), None)
    if with_it is not None:
        return [c for c in with_it.components if c.name != effect.name]
    said = answer.likeliest.components
    return [c for c in said if with_kin or not c.form.effect.is_kin_of(effect)]


def _coefficient_deviation(effect: Effect, answer: SensorAnswer) -> float:
    """Return the prior standard deviation of an effect's coefficients, in their own unit."""
    found = (c for s in answer.sets for c in s.components if c.name == effect.name)
    size = answer.hypotheses.design.size_of(answer.hypotheses.design.term(effect))
    return next(found).amplitude / float(size.max())


def named_beside(base: Listed, answers: Mapping[Sensor, SensorAnswer]) -> Listed:
    """Return the effects of the sensors in `base` together with what was named."""
    return {s: joined_effects([*effects, *answers[s].named]) for s, effects in base.items()}


def _differs(noise: NoiseModel, before: NoiseModel, period: float) -> bool:
    """Tell whether the noise of block means has changed either way, or slow noise is gone.

    It is louder where an effect that was fitted as slow noise had taken the place of white noise.
    """
    parts = [(n.variance_of_means(period), n.amplitudes**2) for n in (noise, before)]
    (means, slow), (means_before, slow_before) = parts
    return bool(
        (means < CHANGED_VARIANCE_SHARE * means_before).any()
        or (means_before < CHANGED_VARIANCE_SHARE * means).any()
        or (slow.sum(axis=0) < CHANGED_VARIANCE_SHARE * slow_before.sum(axis=0)).any()
    )


def greyed_out(
    runs: Sequence[PreparedRun], catalogue: Mapping[str, type[Effect]]
) -> dict[str, str]:
    """Return the effects that could not be tried, with the channel that is missing."""
    reasons = {}
    for name, effect in catalogue.items():
        absent = missing_channels(effect, runs)
        if absent:
            reasons[name] = f'needs {", ".join(absent)}, which was not logged'
    return reasons
