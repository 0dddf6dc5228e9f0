# SPDX-License-Identifier: Apache-2.0
"""What several sensors tell of an effect whose coefficients they share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.candidates import form_of
from thermal_comp.diagnosis.evidence.effect_sets import Component, EffectSet
from thermal_comp.diagnosis.evidence.set_fit import fitted_set, scaled
from thermal_comp.diagnosis.sensor_answer import UNNAMED_CAUSES, SensorAnswer
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.gaussian_evidence import ConditionedDesign, log_evidence, log_sum
from thermal_comp.linear.normal_equations import pseudo_solve

EXTENDED_SETS = 5
"""Likeliest sets beside which the effect is looked for, too."""
REFUTING_CHI2 = 20.0
"""χ² against an effect of several sensors that refutes it, whatever flaw its form has."""
REFUTING_SHARE = 2e-4
"""The same as a share of the χ² it explains, where that is more: a flaw in the form of a large
effect costs more."""


def with_effect(name: str, answer: SensorAnswer) -> list[EffectSet]:
    """Return the sets of a sensor with an effect, and the likeliest others with it added.

    An effect that explains little alone was not tried beside others.
    """
    sets = [s for s in answer.sets if name in s.names]
    component = next(c for s in sets for c in s.components if c.name == name)
    known = {s.names for s in sets}
    for some in answer.sets[:EXTENDED_SETS]:
        larger = (*some.components, component)
        names = tuple(sorted(c.name for c in larger))
        if name not in some.names and names not in known:
            sets.append(fitted_set(answer.hypotheses, larger))
    return sets


def weighed_by_all(effect: Effect, searched: Sequence[SensorAnswer]) -> list[EffectSet]:
    """Return the sets of the first sensor, those with an effect as all sensors together see them.

    One set of coefficients is fitted to all sensors, beside what else was named. Where other
    sensors do not feel the effect, it explains less than coefficients of the first sensor alone: a
    scale factor that is equal on all axes is a tilt to the accelerometer in three orientations,
    but not to the magnetometer. Sets of the first sensor without the effect keep their posterior.
    In the others the effect replaces its kin or stands beside them, whichever is likelier: a field
    of the chamber that turns with the device hides how a tilt turns it. Where they refute it, the
    sets with it are left out.
    """
    first, *others = searched
    design = first.hypotheses.design
    deviations = priors.AMPLITUDES / float(design.size_of(design.term(effect)).max())
    seen = [
        [
            _SensorEquations.beside(a, effect, _other_components(effect, a, with_kin=k))
            for a in others
        ]
        for k in (False, True)
    ]
    # What has no name in another sensor is no sign of an effect that this one feels.
    limit = 0.0 if any(answer.kind in UNNAMED_CAUSES for answer in others) else np.inf
    said = sum(answer.sets[0].log_posterior for answer in others)
    sets = [s for s in first.sets if effect.name not in s.names]
    for some in with_effect(effect.name, first):
        rest = [c for c in some.components if c.name != effect.name]
        own = _SensorEquations.beside(first, effect, rest)
        strongest = max((c.amplitude for c in rest), default=None)
        widths = deviations, priors.amplitude_log_prior(strongest)
        alone = _log_weight([own], *widths)
        together = [
            sum(one.log_posterior for one in each) + _log_weight([own, *each], *widths)
            for each in seen
        ]
        support = max(together) - said - alone
        refuted = -0.5 * max(REFUTING_CHI2, REFUTING_SHARE * own.explained)
        if support > refuted:
            support = min(support, limit)
            more = len(some.components)
            one_more = first.hypotheses.log_prior(more) - first.hypotheses.log_prior(more - 1)
            # The fit took the likeliest amplitude; of a small effect they are all about as likely.
            all_amplitudes = own.log_posterior + one_more + alone
            posterior = max(some.log_posterior, all_amplitudes) + support
            sets.append(replace(some, log_prior=some.log_prior + support, log_posterior=posterior))
    return sets


@dataclass(frozen=True, eq=False)
class _SensorEquations:
    """Equations of one sensor for the coefficients of a coupled effect beside its own effects."""

    state: ConditionedDesign
    normal: FloatArray
    """(p, p) normal matrix of the coefficients, in their own units."""
    right: FloatArray
    """(p,) right-hand side."""
    log_posterior: float
    """ln of the posterior of the sensor's own effects, beside the noise that is likeliest with the
    coupled one: louder noise may do what that does."""

    @classmethod
    def beside(
        cls, answer: SensorAnswer, effect: Effect, others: Sequence[Component]
    ) -> _SensorEquations:
        """Return the equations of a sensor beside given components."""
        hypotheses = answer.hypotheses
        term = hypotheses.design.term(effect)
        its = Component(form_of(hypotheses.design, effect, None), float(priors.AMPLITUDES[0]), 1)
        together = scaled(hypotheses, [*others, its], len(others))[0]
        state = hypotheses.conditioned(others, further=together[-1:])
        noise = hypotheses.likeliest_alternative(together)[0] + state.log_evidence
        size = hypotheses.design.size_of(term)
        normal, right = state.shared_equations(term.columns)
        known = answer.set_of(others)
        evidence = hypotheses.log_evidence(known.components)
        evidence += hypotheses.log_odds_of_felt_errors(known.components)
        log_posterior = known.log_posterior - evidence + noise
        return cls(state, normal * np.outer(size, size), right * size, log_posterior)

    def log_gain(self, coefficients: FloatArray) -> float:
        """Return ln of the evidence that given coefficients (p,) add."""
        explained = coefficients @ (2.0 * self.right - self.normal @ coefficients)
        left = self.state.chi_square - float(explained)
        after = log_evidence(left, self.state.log_determinant, self.state.rows)
        return float(after - self.state.log_evidence)

    @property
    def explained(self) -> float:
        """Δχ² of the coefficients that fit this sensor best."""
        answer, _ = pseudo_solve(self.normal, self.right[:, None])
        return float(self.right @ answer[:, 0])


def _log_weight(
    told: Sequence[_SensorEquations], deviations: FloatArray, log_prior: FloatArray
) -> float:
    """Return ln of the evidence that coefficients add, one set for all, integrated over them.

    Laplace's approximation about the likeliest coefficients by all equations and their prior, a
    Gaussian; `deviations` (s,) are those it may have, in the coefficients' unit, with `log_prior`.
    """
    normal = np.sum([one.normal for one in told], axis=0)
    right = np.sum([one.right for one in told], axis=0)
    found = []
    for deviation in deviations:
        inner = np.eye(len(right)) + deviation**2 * normal
        likeliest = np.linalg.solve(inner, deviation**2 * right)
        prior = float(likeliest @ likeliest) / deviation**2 + float(np.linalg.slogdet(inner)[1])
        found.append(sum(one.log_gain(likeliest) for one in told) - 0.5 * prior)
    return log_sum(np.array(found) + log_prior)


def _other_components(effect: Effect, answer: SensorAnswer, *, with_kin: bool) -> list[Component]:
    """Return the effects of a sensor's likeliest set; kin of the effect only `with_kin`.

    That is the set before any of it is taken for a flaw of the rest: the effect would be fitted to
    that flaw.
    """
    said = answer.sets[0].components
    return [c for c in said if with_kin or not c.form.effect.is_kin_of(effect)]
