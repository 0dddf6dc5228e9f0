# SPDX-License-Identifier: Apache-2.0
"""Search the residual of every sensor for effects, alone and for what several sensors feel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import CHANNELS, Sensor
from thermal_comp.data.preparation import PERIOD, PreparedRun
from thermal_comp.diagnosis.candidates import families, missing_channels
from thermal_comp.diagnosis.decision import Outcome, decide_confirmed
from thermal_comp.diagnosis.generic_regressors import generic_regressors
from thermal_comp.diagnosis.search import Search, least_delta_chi2
from thermal_comp.effects.effect import Effect, joined_effects
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.of_runs import noise_beside

REFUTING_CHI2 = 20.0
"""χ² against an effect of several sensors from which no flaw in its form excuses it …"""
REFUTING_SHARE = 2e-4
"""… or this share of what it explains: the larger it is, the more a flaw in its form costs."""
CHANGED_VARIANCE_SHARE = 0.8
"""Share of its variance below which noise is another one."""
Listed = dict[Sensor, tuple[Effect, ...]]
Found = tuple[CandidateDesign, Outcome]


@dataclass(frozen=True, eq=False)
class Settings:
    """What a diagnosis is made with."""

    catalogue: Mapping[str, type[Effect]]
    thresholds: Mapping[str, float] | None = None
    reference: Mapping[str, NoiseModel] | None = None
    """Noise that counts as normal, per sensor; None: the shipped table."""
    bandwidth_known: bool = False
    """Whether the density of white noise is that of the sensor."""


def search_sensors(
    runs: Sequence[PreparedRun],
    base: Listed,
    noise: Mapping[Sensor, NoiseModel],
    settings: Settings,
) -> dict[Sensor, Outcome]:
    """Return what is said about each sensor: first by itself, then where effects are coupled."""
    searches = SensorSearches(ColumnSource(runs), base, noise, settings)
    # Most of the work is done in numpy and compiled loops, where sensors do not wait for another.
    with ThreadPoolExecutor() as pool:
        found = dict(zip(base, pool.map(searches.of_sensor, base), strict=True))
    for effect in settings.catalogue.values():
        if effect.coupled:
            found.update(searches.of_coupled(effect, found))
    return {sensor: outcome for sensor, (_, outcome) in found.items()}


@dataclass(frozen=True, eq=False)
class SensorSearches:
    """The searches over the sensors of a campaign, which share the columns of effects."""

    source: ColumnSource
    base: Listed
    noise: Mapping[Sensor, NoiseModel]
    settings: Settings

    def of_sensor(
        self,
        sensor: Sensor,
        known: Sequence[Effect] = (),
        support: Mapping[str, float] | None = None,
    ) -> Found:
        """Return design and outcome of one sensor; `known` effects stand beside the base.

        What is named and had been taken for noise (a step, a line) has the search begin anew,
        with the noise beside it. `support` is the χ² that other sensors add to an effect.
        """
        beside = (*self.base[sensor], *known)
        found = self._under(self.noise[sensor], sensor, beside, support or {})
        named = named_beside({sensor: beside}, {sensor: found[1]})
        noise = noise_beside(self.source.runs, named, self.noise)[sensor]
        if _quieter(noise, self.noise[sensor]):
            found = self._under(noise, sensor, beside, support or {})
        return found

    def of_coupled(
        self, effect: type[Effect], found: Mapping[Sensor, Found]
    ) -> dict[Sensor, Found]:
        """Return what changes where several sensors feel an effect with the same coefficients.

        A fixture that tilts turns gravity and field alike. Such an effect is looked for in its
        first sensor; where that may have found it the others are asked, and if it is named then,
        they are searched with it as known.
        """
        asked = [sensor for sensor in effect.sensors if sensor in found]
        if len(asked) < 2 or not _may_be(effect, found[asked[0]][1]):
            return {}
        first, *others = asked
        support = coupled_support(effect(), [found[sensor] for sensor in asked])
        again = {first: self.of_sensor(first, support={effect.name: support})}
        named = [n.scored.form.effect for n in again[first][1].named]
        forms = [form for form in named if form.name == effect.name]
        return again | {s: self.of_sensor(s, forms) for s in others if forms}

    def _under(
        self,
        noise: NoiseModel,
        sensor: Sensor,
        known: Sequence[Effect],
        support: Mapping[str, float],
    ) -> Found:
        """Return design and outcome of one sensor under a given noise."""
        runs, catalogue = self.source.runs, self.settings.catalogue
        design = CandidateDesign(self.source, sensor, noise, known)
        once = {effect.name for effect in known if not effect.repeatable}
        offered = {
            name: effect
            for name, effect in catalogue.items()
            if name not in once
            and not (effect.coupled and sensor != effect.sensors[0] and len(self.base) > 1)
        }
        search = Search(
            design,
            families(design, offered),
            self.settings.thresholds,
            support=support,
            untried=frozenset(offered) & frozenset(greyed_out(runs, catalogue)),
            least_delta_chi2=least_delta_chi2(self.source, sensor, noise, known, catalogue),
        )
        missing = [c for c in CHANNELS if not any(run.conditions.has(c) for run in runs)]
        return design, decide_confirmed(search, generic_regressors(design), missing, known)


def coupled_support(effect: Effect, searched: Sequence[Found]) -> float:
    """Return the χ² that other sensors add to an effect of the first; −∞: they refute it.

    One set of coefficients, fitted to all sensors beside what else was named, explains less than
    the first alone would like where the others do not feel it: a scale factor that is equal on
    all axes is a tilt to the accelerometer in three orientations, but not to the magnetometer.
    """
    equations = []
    for design, outcome in searched:
        known = [
            term
            for named in outcome.named
            if effect.name not in (named.scored.name, *named.ambiguous_with)
            for term in named.scored.form.terms
        ]
        equations.append(design.shared_equations(known, design.term(effect)))
    alone = _explained_by(*equations[0])
    normals, rights = zip(*equations, strict=True)
    support = _explained_by(np.sum(normals, axis=0), np.sum(rights, axis=0)) - alone
    return support if support > -max(REFUTING_CHI2, REFUTING_SHARE * alone) else -np.inf


def _may_be(effect: type[Effect], outcome: Outcome) -> bool:
    """Tell whether an effect is named, or explains what is named as well."""
    return any(effect.name in (n.scored.name, *n.ambiguous_with) for n in outcome.named)


def _explained_by(normal: FloatArray, right: FloatArray) -> float:
    return float(right @ np.linalg.pinv(normal, rcond=1e-9, hermitian=True) @ right)


def named_beside(base: Listed, outcomes: Mapping[Sensor, Outcome]) -> Listed:
    """Return the effects of the sensors in `base` together with what was named."""
    return {
        s: joined_effects([*effects, *(n.scored.form.effect for n in outcomes[s].named)])
        for s, effects in base.items()
    }


def _quieter(noise: NoiseModel, before: NoiseModel) -> bool:
    """Tell whether a part of the noise, fast or slow, is gone that was there before."""
    parts = [(n.variance_of_means(PERIOD), n.amplitudes**2) for n in (noise, before)]
    (means, slow), (means_before, slow_before) = parts
    total = slow_before.sum(axis=0)
    return bool(
        (means < CHANGED_VARIANCE_SHARE * means_before).any()
        or (slow.sum(axis=0) < CHANGED_VARIANCE_SHARE * total).any()
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
