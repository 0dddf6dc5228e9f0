# SPDX-License-Identifier: Apache-2.0
"""What explains the residual of each sensor, alone and where several sensors feel an effect."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray
from scipy.special import expit

from thermal_comp.data.blocks import in_search_blocks
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.spectral_lines import spectral_lines
from thermal_comp.diagnosis.coupled_effects import weighed_by_all
from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.candidates import missing_channels
from thermal_comp.diagnosis.evidence.common_thermometer import information_of_others
from thermal_comp.diagnosis.evidence.effect_sets import (
    NOT_IN_CATALOGUE,
    UNLOGGED,
    EffectSet,
    Names,
)
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.diagnosis.evidence.posterior import explanations, probability
from thermal_comp.diagnosis.evidence.set_fit import set_of_model
from thermal_comp.diagnosis.evidence.set_search import likeliest_sets
from thermal_comp.diagnosis.noise_level import NoiseReference
from thermal_comp.diagnosis.sensor_answer import UNNAMED_CAUSES, FoundElsewhere, SensorAnswer
from thermal_comp.effects.effect import Effect, joined_effects
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.estimation import fit_noise
from thermal_comp.noise.of_runs import (
    independent_axes,
    log_prior_of_loudness,
    noise_beside,
    turned_runs,
    usual_noise,
)

SURE_OF_NOTHING = 0.95
"""Probability that a sensor lacks nothing, from which it is not searched again."""
LEAST_EVIDENCE_DIFFERENCE = 0.5
"""Least change of the ln evidence between likely sets by the other sensors' information."""
COMPARED_SETS = 5
"""Number of likeliest sets that are compared for it."""
CHANGED_VARIANCE_SHARE = 0.8
"""Ratio of two variances of noise, below which they are different."""
SHARE_BEFORE, SHARE_OF_SEARCH = 0.1, 0.75
"""Share of a diagnosis that is done before its sensors are searched, and after them."""
Listed = dict[Sensor, tuple[Effect, ...]]


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
            f'searching the effects of the {sensor}',
            SHARE_BEFORE + (SHARE_OF_SEARCH - SHARE_BEFORE) * number / len(base),
        )
        found[sensor] = searches.of_sensor(sensor)
    settings.progress('comparing what is left of the sensors', SHARE_OF_SEARCH)
    found |= searches.with_one_thermometer(found)
    for effect in settings.catalogue.values():
        if effect.coupled:
            found.update(searches.of_coupled(effect, found))
    return {sensor: with_cause_of_noise(answer) for sensor, answer in found.items()}


@dataclass(frozen=True, eq=False)
class SensorSearches:
    """The searches over the sensors of a campaign, which share the columns of effects."""

    source: ColumnSource
    base: Listed
    noise: Mapping[Sensor, NoiseModel]
    settings: Settings

    def of_sensor(self, sensor: Sensor, known: Sequence[Effect] = ()) -> SensorAnswer:
        """Return the answer about one sensor; `known` effects stand beside the base.

        Noise that is louder than usual may be an effect: the search is repeated with the usual
        noise. Where an effect that is named, or the closest where none is, had been taken for
        noise (a step, a line), it is repeated with the noise beside it. The likeliest answer
        stands.
        """
        beside = (*self.base[sensor], *known)
        axes = independent_axes(self.source.runs, sensor)
        runs = turned_runs(self.source.runs, sensor, axes)
        fitted = self.noise[sensor] if axes is None else fit_noise(runs, sensor, beside)
        usual = usual_noise(runs, sensor, fitted)
        found = self._answer_with_noise(fitted, sensor, beside, axes)
        if usual is not None:
            other = self._answer_with_noise(usual, sensor, beside, axes)
            found = _likelier(found, other, usual)
        before = found.hypotheses.design.noise
        likely = {sensor: joined_effects([*beside, *found.named, *found.closest])}
        noise = noise_beside(runs, likely, {sensor: before})[sensor]
        if _differs(noise, before, runs[0].period):
            other = self._answer_with_noise(noise, sensor, beside, axes)
            found = _likelier(found, other, usual)
        return replace(found, usual_noise=usual)

    def with_one_thermometer(
        self, found: Mapping[Sensor, SensorAnswer]
    ) -> dict[Sensor, SensorAnswer]:
        """Return the answers that change by the information of others on the thermometer's errors.

        Sensors that lack something without a name give no information. A sensor that lacks nothing
        is not searched again, nor one whose likeliest sets keep their evidence.
        """
        understood = {s for s, a in found.items() if a.kind not in UNNAMED_CAUSES}
        told = information_of_others(
            {s: (a.hypotheses, a.sets) for s, a in found.items()}, understood
        )
        again = {}
        for sensor, answer in found.items():
            nothing = probability(answer.explanations, lambda e: e.names == ())
            if sensor in told and nothing < SURE_OF_NOTHING:
                hypotheses, likeliest = answer.hypotheses, answer.sets[:COMPARED_SETS]
                before = [hypotheses.log_bayes_factor(s.components) for s in likeliest]
                hypotheses.inform(told[sensor].normal, told[sensor].right)
                after = [hypotheses.log_bayes_factor(s.components) for s in likeliest]
                if np.ptp(np.subtract(after, before)) > LEAST_EVIDENCE_DIFFERENCE:
                    told_again = self._answer(hypotheses, likeliest_sets(hypotheses))
                    again[sensor] = replace(told_again, usual_noise=answer.usual_noise)
                else:  # the equations as they were, to which the answer belongs
                    hypotheses.inform(-told[sensor].normal, -told[sensor].right)
        return again

    def of_coupled(
        self, effect: type[Effect], found: Mapping[Sensor, SensorAnswer]
    ) -> dict[Sensor, SensorAnswer]:
        """Return the answers that change by an effect whose coefficients several sensors share.

        A fixture that tilts turns gravity and field alike. Such an effect is searched in its first
        sensor and, where that may have it, weighed with the others. If it is then named, the
        others are searched again with it as known.
        """
        asked = [sensor for sensor in effect.sensors if sensor in found]
        if len(asked) < 2 or not any(
            effect.name in e.names and e.probability > 1e-4 for e in found[asked[0]].explanations
        ):
            return {}
        first, *others = asked
        sets = weighed_by_all(effect(), [found[sensor] for sensor in asked])
        weighed = self._answer(found[first].hypotheses, sets)
        again = {first: replace(weighed, usual_noise=found[first].usual_noise)}
        forms = [form for form in again[first].named if form.name == effect.name]
        certain = again[first].probability_of(effect.name)
        for sensor in others if forms else ():
            elsewhere = FoundElsewhere(effect.name, certain, found[sensor].explanations)
            again[sensor] = replace(self.of_sensor(sensor, forms), elsewhere=elsewhere)
        return again

    def _answer_with_noise(
        self,
        noise: NoiseModel,
        sensor: Sensor,
        known: Sequence[Effect],
        axes: FloatArray | None,
    ) -> SensorAnswer:
        """Return the answer about one sensor under a given noise, independent along `axes`."""
        design = CandidateDesign(self.source, sensor, noise, known, axes=axes)
        hypotheses = self.hypotheses(design, known)
        return self._answer(hypotheses, likeliest_sets(hypotheses))

    def _answer(self, hypotheses: SensorHypotheses, sets: Sequence[EffectSet]) -> SensorAnswer:
        ranked = sorted(sets, key=lambda s: -s.log_posterior)
        catalogue = self.settings.catalogue
        found, evidence = explanations(hypotheses, ranked)
        return SensorAnswer(
            hypotheses=hypotheses,
            sets=tuple(ranked),
            explanations=tuple(found),
            offered=tuple(family.effect for family in hypotheses.families),
            untried=frozenset(catalogue) & frozenset(greyed_out(self.source.runs, catalogue)),
            log_evidence=hypotheses.nothing + evidence + hypotheses.design.log_density,
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
        return SensorHypotheses(design, offered, known=set_of_model(design, known))


def named_beside(base: Listed, answers: Mapping[Sensor, SensorAnswer]) -> Listed:
    """Return the effects of the sensors in `base` together with what was named."""
    return {s: joined_effects([*effects, *answers[s].named]) for s, effects in base.items()}


def _likelier(one: SensorAnswer, other: SensorAnswer, usual: NoiseModel | None) -> SensorAnswer:
    """Return the likelier of two answers; noise that is louder than the usual one is less so."""
    either = (one, other)
    if usual is None:
        return max(either, key=lambda answer: answer.log_evidence)
    period = one.hypotheses.design.source.runs[0].period
    return max(
        either,
        key=lambda a: (
            a.log_evidence + log_prior_of_loudness(a.hypotheses.design.noise, usual, period)
        ),
    )


def with_cause_of_noise(answer: SensorAnswer) -> SensorAnswer:
    """Return an answer in which noise that is louder than usual may have a cause without a name.

    Such a cause explains the rows as well as the noise that was fitted to them: only what is
    believed beforehand tells them apart. Explanations that have one already stay as they are.
    """
    design, usual = answer.hypotheses.design, answer.usual_noise
    if usual is None:
        return answer
    loudness = log_prior_of_loudness(design.noise, usual, design.source.runs[0].period)
    if loudness == 0.0:
        return answer
    law, lost = priors.unnamed_over_time()
    share = lost / (law + lost) if answer.hypotheses.lost_over_time else 0.0
    gains: dict[Names, float] = {(UNLOGGED,): 0.0, (NOT_IN_CATALOGUE,): 0.0}
    changed = []
    for one in answer.explanations:
        odds = priors.log_odds_of_cause_of_noise(loudness, beside=bool(one.names))
        unnamed = {UNLOGGED, NOT_IN_CATALOGUE} & {*one.names}
        moved = 0.0 if unnamed else float(expit(odds)) * one.probability
        changed.append(replace(one, probability=one.probability - moved))
        gains[UNLOGGED,] += share * moved
        gains[NOT_IN_CATALOGUE,] += (1.0 - share) * moved
    changed = [replace(e, probability=e.probability + gains.get(e.names, 0.0)) for e in changed]
    return replace(answer, explanations=tuple(sorted(changed, key=lambda e: -e.probability)))


def _differs(noise: NoiseModel, before: NoiseModel, period: float) -> bool:
    """Tell whether noise differs: variance of block means, either way, or less slow noise.

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
