# SPDX-License-Identifier: Apache-2.0
"""What several sensors tell of an effect whose coefficients they share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.diagnosis.evidence.effect_sets import Component, EffectSet
from thermal_comp.diagnosis.evidence.set_fit import fitted_set
from thermal_comp.diagnosis.sensor_answer import SensorAnswer
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.gaussian_evidence import ConditionedDesign, log_evidence
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


def coupled_support(effect: Effect, searched: Sequence[SensorAnswer]) -> float:
    """Return ln of what other sensors add to the odds of an effect of the first; −∞: refuted.

    One set of coefficients is fitted to all sensors, beside what else was named. Where other
    sensors do not feel the effect, it explains less than coefficients of the first sensor alone: a
    scale factor that is equal on all axes is a tilt to the accelerometer in three orientations,
    but not to the magnetometer. The prior of the coefficients is as wide as in the first sensor.
    In the others the effect replaces its kin or stands beside them, whichever is likelier: a field
    of the chamber that turns with the device hides how a tilt turns it.
    """
    deviation = _coefficient_deviation(effect, searched[0])
    first = _SensorEquations.beside(searched[0], effect, _other_components(effect, searched[0]))
    alone = _log_weight([first], deviation)
    best = -np.inf
    for beside_kin in (False, True):
        others = [
            _SensorEquations.beside(
                answer, effect, _other_components(effect, answer, with_kin=beside_kin)
            )
            for answer in searched[1:]
        ]
        odds = sum(one.log_odds for one in others)
        best = max(best, odds + _log_weight([first, *others], deviation) - alone)
    refuted = -0.5 * max(REFUTING_CHI2, REFUTING_SHARE * first.explained)
    return best if best > refuted else -np.inf


@dataclass(frozen=True, eq=False)
class _SensorEquations:
    """Equations of one sensor for the coefficients of a coupled effect beside its own effects."""

    state: ConditionedDesign
    normal: FloatArray
    """(p, p) normal matrix of the coefficients, in their own units."""
    right: FloatArray
    """(p,) right-hand side."""
    log_odds: float
    """ln of the odds of those own effects against the sensor's likeliest set."""

    @classmethod
    def beside(
        cls, answer: SensorAnswer, effect: Effect, others: Sequence[Component]
    ) -> _SensorEquations:
        """Return the equations of a sensor beside given components."""
        hypotheses = answer.hypotheses
        term = hypotheses.design.term(effect)
        state = hypotheses.conditioned(others)
        size = hypotheses.design.size_of(term)
        normal, right = state.shared_equations(term.columns)
        said = answer.set_of(answer.likeliest.components)
        log_odds = answer.set_of(others).log_posterior - said.log_posterior
        return cls(state, normal * np.outer(size, size), right * size, log_odds)

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


def _log_weight(told: Sequence[_SensorEquations], deviation: float) -> float:
    """Return ln of the evidence that coefficients add, one set for all, integrated over them.

    Laplace's approximation about the likeliest coefficients by all equations and their prior, a
    Gaussian of standard deviation `deviation`.
    """
    normal = deviation**2 * np.sum([one.normal for one in told], axis=0)
    right = deviation**2 * np.sum([one.right for one in told], axis=0)
    inner = np.eye(len(right)) + normal
    likeliest = np.linalg.solve(inner, right)
    prior = float(likeliest @ likeliest) / deviation**2 + float(np.linalg.slogdet(inner)[1])
    return sum(one.log_gain(likeliest) for one in told) - 0.5 * prior


def _other_components(
    effect: Effect, answer: SensorAnswer, *, with_kin: bool = False
) -> list[Component]:
    """Return the other effects of a sensor's likeliest set; its kin among them only `with_kin`."""
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
