# SPDX-License-Identifier: Apache-2.0
"""Search for the sets of effects that explain a sensor's residual best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.candidates import Family, alternatives, renewed
from thermal_comp.diagnosis.evidence.effect_sets import Component, EffectSet, Names
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.diagnosis.evidence.set_fit import evidence_of_forms, fitted_set
from thermal_comp.linear.gaussian_evidence import ConditionedDesign, log_sum

MOST_EFFECTS = 3
"""Effects in a set."""
KEPT_SETS = 5
"""Sets of each size that are extended."""
TRIED_ADDITIONS = 4
"""Effects each of them is extended by."""
LEAST_LOG_EVIDENCE_GAIN = 2.0
"""Least gain of ln evidence, before any prior, from which an addition is looked at closely."""
CLEAR_LOG_EVIDENCE_GAIN = 10.0
"""Gain of the best addition from which no other amount of slow noise is looked at."""
PROMISING_SHARE = 0.3
"""Share of the best addition's gain of ln evidence from which another is fitted …"""
LOG_EVIDENCE_LEEWAY = 15.0
"""… less this: on a coarse grid of shapes an addition gains less than it does once fitted."""


@dataclass(frozen=True)
class Addition:
    """What a family would add to a set."""

    log_gain: float
    """ln of the evidence it adds, shapes and amplitude integrated."""
    peak: float
    """The same of its best form."""
    component: Component


def likeliest_sets(hypotheses: SensorHypotheses) -> list[EffectSet]:
    """Return the sets that were looked at, most probable first."""
    nothing = hypotheses.log_prior(0)
    found: dict[Names, EffectSet] = {(): EffectSet((), nothing, nothing, 0.0)}
    grown = [found[()]]
    for size in range(1, MOST_EFFECTS + 1):
        larger = _extended(hypotheses, grown, found)
        found |= larger
        best = max((s.log_posterior for s in larger.values()), default=-np.inf)
        smaller = [s.log_posterior for n, s in found.items() if len(n) < size]
        if best < max(smaller) - 1.0 and size > 1:
            break
        ranked = sorted(larger.values(), key=lambda s: -s.log_posterior)
        grown = [s for s in ranked if s.explained > 0.0][:KEPT_SETS]
        if not grown:
            break
    found |= _with_twins(hypotheses, found)
    return sorted(found.values(), key=lambda s: -s.log_posterior)


def _with_twins(
    hypotheses: SensorHypotheses, found: Mapping[Names, EffectSet]
) -> dict[Names, EffectSet]:
    """Return the likeliest sets with the twin of an effect in its place, where not yet known.

    What little tells twins apart is weighed later, so that both have to stand there.
    """
    ranked = sorted(found.values(), key=lambda s: -s.log_posterior)
    families = {family.name: family for family in hypotheses.families}
    more: dict[Names, EffectSet] = {}
    for some in ranked[:KEPT_SETS]:
        for one in some.components:
            twin = one.form.effect.twin
            others = [c for c in some.components if c is not one]
            names = tuple(sorted((twin, *(c.name for c in others))))
            if twin in families and twin not in some.names and names not in {*found, *more}:
                state = hypotheses.conditioned(others)
                prior = priors.amplitude_log_prior(one.amplitude if others else None)
                added = _addition(hypotheses, state, families[twin], prior)
                more[names] = fitted_set(hypotheses, (*others, added.component))
    return more


def _extended(
    hypotheses: SensorHypotheses, sets: Sequence[EffectSet], known: Mapping[Names, EffectSet]
) -> dict[Names, EffectSet]:
    """Return the sets with one effect more, the promising ones fitted together."""
    larger: dict[Names, EffectSet] = {}
    for before in sets:
        additions = additions_to(hypotheses, before)
        leader = max((a.peak for a in additions.values()), default=0.0)
        ranked = sorted(additions.values(), key=lambda a: -a.peak)
        for place, addition in enumerate(ranked):
            names = tuple(sorted((*before.names, addition.component.name)))
            if names in larger or names in known:
                continue
            promising = addition.peak > max(
                LEAST_LOG_EVIDENCE_GAIN, PROMISING_SHARE * leader - LOG_EVIDENCE_LEEWAY
            )
            most = TRIED_ADDITIONS if before.components else 2 * TRIED_ADDITIONS
            if promising and place < most:
                larger[names] = fitted_set(hypotheses, (*before.components, addition.component))
            elif not before.components:
                prior = hypotheses.log_prior(1)
                one = (addition.component,)
                larger[names] = EffectSet(one, prior + addition.log_gain, prior, 0.0)
        if before.components:
            hypotheses.unseen[before.names] = _unseen(hypotheses, before, additions)
    return larger


def _unseen(
    hypotheses: SensorHypotheses, before: EffectSet, additions: Mapping[str, Addition]
) -> dict[str, float]:
    """Return the odds of effects beside a set that would be too small to be seen."""
    size = len(before.components)
    more = hypotheses.log_prior(size + 1) - hypotheses.log_prior(size)
    return {
        name: float(np.exp(more + one.log_gain))
        for name, one in additions.items()
        if one.peak < LEAST_LOG_EVIDENCE_GAIN and not one.component.form.effect.guessed_channel
    }


def additions_to(
    hypotheses: SensorHypotheses, before: EffectSet, *, thermometer: bool = True
) -> dict[str, Addition]:
    """Return what each family not in the set would add to it, roughly.

    `thermometer`: beside the thermometer's errors.
    """
    whole = before.beside(hypotheses.known)
    strongest = float(np.sqrt(whole.explained)) if whole.components else None
    amplitude_prior = priors.amplitude_log_prior(strongest)
    taken = {c.name for c in before.components if not c.form.effect.repeatable}
    offered = [f for f in (*hypotheses.families, *hypotheses.guesses) if f.name not in taken]
    if before.components:
        known = [c.form for c in before.components]
        offered = [
            renewed(hypotheses.design, f, known) if f.effect.repeatable else f for f in offered
        ]
    # In a short run the edge of a known step may be all that another could be.
    offered = [family for family in offered if family.forms]
    found: list[tuple[float, dict[str, Addition]]] = []
    for ln, nuisances in hypotheses.with_less_noise(before.components):
        state = hypotheses.conditioned(
            before.components, thermometer=thermometer, nuisances=nuisances
        )
        each = {f.name: _addition(hypotheses, state, f, amplitude_prior) for f in offered}
        found.append((ln + state.log_evidence, each))
        if len(found) == 1 and any(a.peak > CLEAR_LOG_EVIDENCE_GAIN for a in each.values()):
            break
    return _beside_any_noise(found)


def _beside_any_noise(
    found: Sequence[tuple[float, Mapping[str, Addition]]],
) -> dict[str, Addition]:
    """Return additions integrated over amounts of slow noise.

    `found`: ln of prior times evidence of each amount without an addition, and those beside it.
    """
    before = log_sum([weight for weight, _ in found])
    together: dict[str, Addition] = {}
    for name in found[0][1]:
        each = [(weight - before, additions[name]) for weight, additions in found]
        best = max(each, key=lambda pair: pair[0] + pair[1].peak)[1]
        gain = log_sum([weight + a.log_gain for weight, a in each])
        peak = log_sum([weight + a.peak for weight, a in each])
        together[name] = Addition(gain, peak, best.component)
    return together


def _addition(
    hypotheses: SensorHypotheses,
    state: ConditionedDesign,
    family: Family,
    amplitude_prior: FloatArray,
) -> Addition:
    before = state.log_evidence
    integrals: list[float] = []
    best: tuple[float, Component] | None = None
    for forms in family.alike:
        count = alternatives(hypotheses.design, family, forms[0])
        weighted = evidence_of_forms(state, forms) + amplitude_prior - before
        each = np.logaddexp.reduce(weighted, axis=1)
        integrals += (each - np.log(count)).tolist()
        k = int(np.argmax(each))
        if best is None or each[k] > best[0]:
            amplitude = float(priors.AMPLITUDES[int(np.argmax(weighted[k]))])
            component = Component(forms[k], amplitude, count)
            best = float(each[k]), component
    assert best is not None  # noqa: S101 (no family is empty)
    return Addition(log_sum(integrals), *best)


def best_single(hypotheses: SensorHypotheses, family: Family) -> EffectSet:
    """Return the best form of one family alone, with its posterior."""
    addition = _addition(
        hypotheses, hypotheses.conditioned(()), family, priors.amplitude_log_prior(None)
    )
    return fitted_set(hypotheses, [addition.component])
