# SPDX-License-Identifier: Apache-2.0
"""What several sensors tell of an effect whose coefficients they share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.diagnosis.evidence.effect_sets import Component, EffectSet
from thermal_comp.diagnosis.sensor_answer import SensorAnswer
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.gaussian_evidence import ConditionedDesign, log_evidence

EXTENDED_SETS = 5
"""Likeliest sets beside which the effect is looked for, too."""
REFUTING_CHI2 = 20.0
"""χ² against an effect of several sensors from which no flaw in its form excuses it …"""
REFUTING_SHARE = 2e-4
"""… or this share of what it explains: the larger it is, the more a flaw in its form costs."""


def with_effect(name: str, answer: SensorAnswer) -> list[EffectSet]:
    """Return the sets of a sensor with an effect, and the likeliest others with it added.

    Alone it may explain little, and was then not looked for beside others.
    """
    sets = [s for s in answer.sets if name in s.names]
    component = next(c for s in sets for c in s.components if c.name == name)
    known = {s.names for s in sets}
    for some in answer.sets[:EXTENDED_SETS]:
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
