# SPDX-License-Identifier: Apache-2.0
"""Shapes and amplitudes of the effects of a set beside each other, and the set's posterior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.candidates import Form, alternatives, form_of, moved_forms
from thermal_comp.diagnosis.evidence.effect_sets import NO_EFFECT, Component, EffectSet
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.candidate_design import CandidateDesign
from thermal_comp.linear.gaussian_evidence import ConditionedDesign, log_sum

SHAPE_RATIOS = (1.25, 1.06, 1.02, 1.005, 1.001, 1.0002, 1.00005, 1.00001)
"""Factors by which shape parameters are moved, ever smaller; the peak lies between them."""
LEAST_LOG_GAIN = 0.05
"""Gain of ln evidence from which a move goes on."""
MOST_MOVES = 12
"""Moves of a shape by one factor."""
CURVATURE_RATIO = 1.04
"""Factor over which the peak of the evidence over a shape parameter is measured."""


def fitted_set(hypotheses: SensorHypotheses, components: Sequence[Component]) -> EffectSet:
    """Return components fitted together, with the posterior of their set."""
    names = tuple(sorted(c.name for c in components))
    before = hypotheses.fits.get(names)
    if before is None:
        fitted = _fitted(hypotheses, list(components), SHAPE_RATIOS)
        if len(components) > 1:
            fitted = _fitted(hypotheses, fitted, SHAPE_RATIOS[1:])
    else:
        fitted = _fitted(hypotheses, list(before), SHAPE_RATIOS[1:])
    hypotheses.fits[names] = tuple(fitted)
    return _weighed(hypotheses, fitted)


def set_of_model(design: CandidateDesign, effects: Sequence[Effect]) -> EffectSet:
    """Return the effects of a model that its design has taken out, with what they explain.

    A line says nothing of its own, nor does an effect whose coefficients have a prior.
    """
    named = [
        effect
        for effect in effects
        if not isinstance(effect, BiasTemperature) and effect.coefficient_deviations() is None
    ]
    if not named:
        return NO_EFFECT
    line = [effect for effect in effects if effect not in named]
    beside = CandidateDesign(design.source, design.sensor, design.noise, line, axes=design.axes)
    hypotheses = SensorHypotheses(beside, {})
    first = float(priors.AMPLITUDES[0])
    components = [Component(form_of(beside, effect, None), first, 1) for effect in named]
    for place in range(len(components)):
        components = scaled(hypotheses, components, place)[0]
    return replace(
        NO_EFFECT, components=tuple(components), explained=hypotheses.explained(components)
    )


def _fitted(
    hypotheses: SensorHypotheses, components: list[Component], ratios: Sequence[float]
) -> list[Component]:
    """Return the components with their best shapes and amplitudes beside each other."""
    for place in range(len(components)):
        components = _in_likeliest_variant(hypotheses, components, place)
        components = _shaped(hypotheses, components, place, ratios)
        components = scaled(hypotheses, components, place)[0]
    return components


def _in_likeliest_variant(
    hypotheses: SensorHypotheses, components: list[Component], place: int
) -> list[Component]:
    """Return the components with one in the variant that is likeliest beside the others."""
    others = _other_variants(hypotheses, components, place)
    if not others:
        return components
    likely = _FormEvidence(hypotheses, components, place)
    tried = [components[place], *others]
    likeliest = max(tried, key=lambda c: likely(c.form) - float(np.log(c.forms)))
    return [*components[:place], likeliest, *components[place + 1 :]]


def in_each_variant(
    hypotheses: SensorHypotheses, components: Sequence[Component], place: int
) -> list[list[Component]]:
    """Return the components, and with one in the likeliest form of every other variant."""
    others = _other_variants(hypotheses, components, place)
    changed = [[*components[:place], other, *components[place + 1 :]] for other in others]
    return [list(components), *(scaled(hypotheses, some, place)[0] for some in changed)]


def _other_variants(
    hypotheses: SensorHypotheses, components: Sequence[Component], place: int
) -> list[Component]:
    """Return one of the components in the likeliest form of every other variant of its effect.

    Those of a spectral line are told by its frequency.
    """
    one = components[place]
    effect = one.form.effect
    family = next((f for f in hypotheses.families if f.effect is type(effect)), None)
    if family is None or len(family.variants) < 2 or effect.line_frequency is not None:
        return []
    state = hypotheses.conditioned([*components[:place], *components[place + 1 :]])
    found = []
    for variant, forms in family.variants.items():
        if variant != effect.variant:
            evidence = evidence_of_forms(state, forms)
            best = forms[int(np.argmax(np.logaddexp.reduce(evidence, axis=1)))]
            count = alternatives(hypotheses.design, family, best)
            found.append(replace(one, form=best, forms=count))
    return found


def evidence_of_forms(state: ConditionedDesign, forms: Sequence[Form]) -> FloatArray:
    """Return (k, s) ln evidence of k forms with as many columns, at s AMPLITUDES."""
    return state.evidences(
        np.array([form.columns for form in forms]),
        priors.AMPLITUDES,
        shared=forms[0].terms[0].shared,
        relative=np.array([form.relative for form in forms]),
    )[0]


def _shaped(
    hypotheses: SensorHypotheses, components: list[Component], place: int, ratios: Sequence[float]
) -> list[Component]:
    """Move the shape parameters of one component while that explains more."""
    one = components[place]
    if one.form.free == 0:
        return components
    likely = _FormEvidence(hypotheses, components, place)
    each_way = _unit_ways(one.form.free)
    best = one.form
    with hypotheses.design.trials():
        for ratio in ratios:
            for _ in range(MOST_MOVES):
                near = moved_forms(hypotheses.design, best, ratio, each_way)
                inside = [form for form in near if form is not None]
                nearest = max(inside, key=likely, default=best)
                if likely(nearest) < likely(best) + LEAST_LOG_GAIN:
                    break
                best = nearest
            values = [None if form is None else likely(form) for form in near]
            peak = moved_forms(hypotheses.design, best, ratio, [_peak(likely(best), values)])[0]
            if peak is not None and likely(peak) > likely(best):
                best = peak
            if all(abs(v - likely(best)) < LEAST_LOG_GAIN for v in values if v is not None):
                break  # a finer move changes nothing
    return _with_form(components, place, form_of(hypotheses.design, best.effect, one.form.run))


def _with_form(components: Sequence[Component], place: int, form: Form) -> list[Component]:
    """Return the components with one in another form."""
    changed = replace(components[place], form=form)
    return [*components[:place], changed, *components[place + 1 :]]


class _FormEvidence:
    """ln evidence of a set with one component in any form; that of known forms is kept."""

    def __init__(
        self, hypotheses: SensorHypotheses, components: Sequence[Component], place: int
    ) -> None:
        self._hypotheses, self._components, self._place = hypotheses, components, place
        self._nuisances = hypotheses.likeliest_nuisances(components)
        self._known: dict[Effect, float] = {}

    def __call__(self, form: Form) -> float:
        if form.effect not in self._known:
            some = _with_form(self._components, self._place, form)
            self._known[form.effect] = self._hypotheses.joint(some, self._nuisances)[0]
        return self._known[form.effect]


def scaled(
    hypotheses: SensorHypotheses, components: list[Component], place: int
) -> tuple[list[Component], float]:
    """Return the components with one's best amplitude, and ln of the sum over amplitudes.

    The sum is relative to the evidence at the best one.
    """
    grid = priors.AMPLITUDES
    known: dict[int, float] = {}
    nuisances = hypotheses.likeliest_nuisances(components)
    best = int(np.argmin(np.abs(np.log(grid / components[place].amplitude))))
    here = -1
    while best != here:
        here = best
        near = [i for i in (here - 1, here, here + 1) if 0 <= i < len(grid)]
        for i in near:
            if i not in known:
                some = _with_amplitude(components, place, float(grid[i]))
                known[i] = hypotheses.joint(some, nuisances)[0]
        best = max(near, key=known.__getitem__)
    total = log_sum([*known.values()]) - known[here]
    return _with_amplitude(components, place, float(grid[here])), total


def _with_amplitude(
    components: Sequence[Component], place: int, amplitude: float
) -> list[Component]:
    """Return the components with one of another amplitude."""
    changed = replace(components[place], amplitude=amplitude)
    return [*components[:place], changed, *components[place + 1 :]]


def _weighed(hypotheses: SensorHypotheses, components: list[Component]) -> EffectSet:
    """Return the set with its posterior: amplitudes and shapes integrated about their best."""
    occam = 0.0
    for place in range(len(components)):
        components, total = scaled(hypotheses, components, place)
        occam += total + _shape_share(hypotheses, components, place)
    evidence = hypotheses.log_evidence(components)
    evidence += hypotheses.log_odds_of_felt_errors(components)
    prior = hypotheses.log_prior(len(components))
    prior += _amplitudes_log_prior(components, hypotheses.known.components)
    return EffectSet(
        tuple(components),
        prior + evidence + occam - hypotheses.nothing,
        prior,
        hypotheses.explained(components),
    )


def _amplitudes_log_prior(components: Sequence[Component], known: Sequence[Component]) -> float:
    """Return ln of the prior of the amplitudes: the strongest free, the others beside it.

    The strongest of the `known` effects, those of the model, counts among them; its own prior is
    the same for every set and left out.
    """
    strongest = [max(c.amplitude for c in known)] if known else []
    ordered = sorted([*(c.amplitude for c in components), *strongest], reverse=True)
    total = 0.0 if known else float(priors.amplitude_log_prior(None)[0])
    for amplitude in ordered[1:]:
        beside = priors.amplitude_log_prior(ordered[0])
        total += float(np.interp(np.log(amplitude), np.log(priors.AMPLITUDES), beside))
    return total


def _shape_share(hypotheses: SensorHypotheses, components: list[Component], place: int) -> float:
    """Return ln of the share of the prior over shapes that the peak of the evidence takes."""
    one = components[place]
    share = -float(np.log(one.forms))
    if one.form.free == 0:
        return share
    nuisances = hypotheses.likeliest_nuisances(components)
    here = hypotheses.joint(components, nuisances)[0]
    with hypotheses.design.trials():
        near = moved_forms(hypotheses.design, one.form, CURVATURE_RATIO, _unit_ways(one.form.free))
        moved = [_with_form(components, place, f) for f in near if f]
        trials = [hypotheses.joint(some, nuisances)[0] for some in moved]
        drops = [max(here - trial, 1e-3) for trial in trials]
    if not drops:
        return share
    widths = np.log(CURVATURE_RATIO) * np.sqrt(np.pi / np.array(drops))
    wide = one.form.free * float(np.log(widths / priors.SHAPE_STEP_LN).mean())
    # A peak as wide as the grid or wider is what the sum over the grid is.
    return share + min(wide, float(np.log(one.forms)))


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
