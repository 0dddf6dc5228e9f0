# SPDX-License-Identifier: Apache-2.0
"""One thermometer, several sensors: what one tells of the thermometer's errors holds for all.

A lag that accelerometer, gyroscope and magnetometer show alike, each in proportion to its slope
over temperature, is the thermometer's; one that a single sensor shows is that sensor's. With c
the thermometer's errors and D the covariance of their prior, a sensor's rows beside a set of
effects say ln p(rows | c) = bᵀc − ½ cᵀNc up to a constant, so that of several sensors, with
N = Σ N_s and b = Σ b_s,

    ln p(rows) = Σ ln p_s + ½ bᵀ(D⁻¹ + N)⁻¹b − ½ ln |I + DN|.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.effect_sets import EffectSet
from thermal_comp.diagnosis.evidence.flaws import thermometer_acts
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.diagnosis.evidence.set_search import additions_to
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.gaussian_evidence import NOISE_ROWS, log_sum
from thermal_comp.linear.normal_equations import pseudo_solve


@dataclass(frozen=True, eq=False)
class Information:
    """What rows tell of the thermometer's errors, in their own units."""

    normal: FloatArray
    """(p, p)."""
    right: FloatArray
    """(p,)."""

    def __add__(self, other: Information) -> Information:
        return Information(self.normal + other.normal, self.right + other.right)


@dataclass(frozen=True, eq=False)
class SensorInformation:
    """A sensor's information beside a set of effects, and ln of what speaks for the set."""

    information: Information
    log_weight: float


Searched = Mapping[Sensor, tuple[SensorHypotheses, Sequence[EffectSet]]]
"""Hypotheses about each sensor and the sets that were looked at."""


def information_of_others(
    searched: Searched, understood: Collection[Sensor]
) -> dict[Sensor, Information]:
    """Return for each sensor the information of the others on the thermometer's errors.

    Only sensors that are `understood` count: an error without a name may look like anything. Every
    sensor has two readings, beside its likeliest set and beside the likeliest without effects of
    the temperature's history, which the thermometer may imitate. The combination of readings
    counts that is likeliest for all sensors together.
    """
    readings = {s: _readings(*found) for s, found in searched.items()}
    tellers = [s for s in searched if s in understood]
    if not tellers:
        return {}
    likeliest = max(product(*(readings[s] for s in tellers)), key=_log_posterior)
    told = {}
    for sensor in searched:
        others = [
            reading.information
            for teller, reading in zip(tellers, likeliest, strict=True)
            if teller != sensor
        ]
        if others:
            told[sensor] = with_likeliest_flaw(_sum(others), readings[sensor])
    return told


def with_likeliest_flaw(told: Information, own: Sequence[SensorInformation]) -> Information:
    """Return information of others with the flaw that is likeliest beside a sensor's own.

    The evidence of both together over that of what is told: it falls where effects of the others
    looked like errors of the thermometer, and so speak against what the sensor sees.
    """
    weighed = []
    for share, probability in priors.THERMOMETER_FLAWS:
        flawed = _with_limited_precision(told, share)
        together = [one.log_weight + _log_evidence(one.information + flawed) for one in own]
        weight = log_sum(together) - _log_evidence(flawed) + float(np.log(probability))
        weighed.append((weight, flawed))
    return max(weighed, key=lambda pair: pair[0])[1]


def _readings(hypotheses: SensorHypotheses, sets: Sequence[EffectSet]) -> list[SensorInformation]:
    """Return the information of one sensor beside either set."""
    best = max(sets, key=lambda s: s.log_posterior)
    plain = [s for s in sets if not any(c.form.effect.kin == 'temperature' for c in s.components)]
    without = max(plain, key=lambda s: s.log_posterior)
    return [_reading(hypotheses, some) for some in dict.fromkeys((best, without))]


def _reading(hypotheses: SensorHypotheses, some: EffectSet) -> SensorInformation:
    state = hypotheses.conditioned(some.components, thermometer=False)
    normal, right = state.shared_equations(hypotheses.thermometer.columns)
    left = state.chi_square - right @ pseudo_solve(normal, right[:, None])[0][:, 0]
    variance = max(float(left + NOISE_ROWS) / (state.rows + NOISE_ROWS), 1.0)
    size = hypotheses.design.size_of(hypotheses.thermometer)
    told = Information(normal * np.outer(size, size) / variance, right * size / variance)
    return SensorInformation(told, some.log_posterior - _log_evidence(told))


def _log_posterior(readings: Sequence[SensorInformation]) -> float:
    together = _sum([reading.information for reading in readings])
    return sum(reading.log_weight for reading in readings) + _log_evidence(together)


def _sum(each: Sequence[Information]) -> Information:
    return sum(each[1:], each[0])


def _log_evidence(told: Information) -> float:
    """Return ln of the evidence that integrating over the thermometer's errors adds."""
    parts = []
    for seconds, probability in priors.THERMOMETER_LAGS_S:
        deviation = priors.thermometer_deviations(seconds, len(told.right))
        inner = np.eye(len(deviation)) + told.normal * np.outer(deviation, deviation)
        right = told.right * deviation
        gain = 0.5 * right @ np.linalg.solve(inner, right) - 0.5 * np.linalg.slogdet(inner)[1]
        parts.append(float(gain) + float(np.log(probability)))
    return log_sum(parts)


def _with_limited_precision(told: Information, share: float) -> Information:
    """Return the information with a precision limited to a share of the thermometer's errors.

    Its columns describe a thermometer only approximately.
    """
    most = max(seconds for seconds, _ in priors.THERMOMETER_LAGS_S)
    deviation = priors.thermometer_deviations(most, len(told.right))
    inner = np.eye(len(deviation)) + told.normal * np.outer(deviation, deviation)
    mean = deviation * np.linalg.solve(inner, told.right * deviation)
    spread = np.diag(np.square(share * np.maximum(abs(mean), 0.1 * deviation)))
    softened = np.linalg.inv(np.eye(len(mean)) + told.normal @ spread)
    return Information(softened @ told.normal, softened @ told.right)


def like_the_thermometer(
    hypotheses: SensorHypotheses, sets: Sequence[EffectSet]
) -> tuple[Effect, ...]:
    """Return the effect of temperature that comes closest to what the thermometer's errors do."""
    if not thermometer_acts(hypotheses):
        return ()
    nothing = next(some for some in sets if not some.components)
    found = additions_to(hypotheses, nothing, thermometer=False).values()
    forms = [(one.peak, one.component.form.effect) for one in found]
    alike = [
        (peak, effect)
        for peak, effect in forms
        if effect.kin == 'temperature' and not (effect.needs or effect.guessed_channel)
    ]
    return tuple(effect for _, effect in sorted(alike, key=lambda one: -one[0])[:1])
