# SPDX-License-Identifier: Apache-2.0
"""Let a model grow: add what is missing, refit everything together, watch the error fall."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thermal_comp.comparison.compare import Comparison, compare_prepared
from thermal_comp.comparison.held_out import hold_out
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import PreparedRun
from thermal_comp.diagnosis.candidates import families, missing_channels
from thermal_comp.diagnosis.diagnose import Settings, base_effects, diagnose_prepared
from thermal_comp.diagnosis.result import Diagnosis
from thermal_comp.diagnosis.search import Search
from thermal_comp.diagnosis.sensor_search import Listed
from thermal_comp.diagnosis.thresholds import threshold_of
from thermal_comp.effects.effect import Effect, joined_effects
from thermal_comp.effects.empirical_term import Empirical
from thermal_comp.fitting.empirical import empirical_form
from thermal_comp.fitting.fit import fit_prepared, usable_sensors
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.model.values import ModelError, NoiseModel, ThermalModel, fitted_shapes
from thermal_comp.noise.of_runs import determined_noise
from thermal_comp.presentation.notebook import Presented

MOST_STEPS = 6
"""Effects added before growing stops."""


@dataclass(frozen=True, eq=False)
class Step:
    """One effect added; rms over the sensors' axes, held out, in the sensor's unit."""

    added: str
    sensors: tuple[Sensor, ...]
    error_before: float
    error_after: float
    noise_floor: float
    ambiguous_with: tuple[str, ...] = ()
    empirical: bool = False
    """Whether no cause is decided: the term only describes what repeats with temperature."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            'added': self.added,
            'sensor': '+'.join(self.sensors),
            'error_before': self.error_before,
            'error_after': self.error_after,
            'noise_floor': self.noise_floor,
            'ambiguous_with': list(self.ambiguous_with),
            'empirical': self.empirical,
        }


@dataclass(frozen=True, eq=False, repr=False)
class Growth(Presented):
    """A grown model and how it came about."""

    presentation = 'growth'

    model: ThermalModel
    before: Comparison
    after: Comparison
    steps: tuple[Step, ...]
    unneeded: tuple[str, ...]
    """`sensor: effect` of terms the others make superfluous."""
    diagnosis: Diagnosis | None = None
    """What is said about the grown model; None where it was not asked for."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values: the comparison after growing, and the steps to it."""
        return self.after.to_dict() | {
            'steps': [step.to_dict() for step in self.steps],
            'parameters': fitted_shapes(self.model),
            'unneeded': list(self.unneeded),
            'undetermined': list(self.model.provenance.notes),
        }


def add_effect(
    model: ThermalModel | None,
    runs: Sequence[PreparedRun],
    name: str,
    settings: Settings,
    sensors: Sequence[Sensor] = (),
) -> Growth:
    """Return the model with an effect added and everything refitted together.

    Without `sensors` the effect goes where its evidence is above its threshold, else to the
    sensor where it has most.
    """
    if name not in settings.catalogue:
        raise ModelError(f'effect {name!r} is not known; known: {", ".join(settings.catalogue)}')
    if not settings.catalogue[name].searched:
        raise ModelError(
            f'{name} is not added by its name: a model has it from the start, or `auto` adds it '
            'where held-out parts confirm it'
        )
    absent = missing_channels(settings.catalogue[name], runs)
    if absent:
        raise ModelError(f'{name} needs {", ".join(absent)}, which was not logged in every run')
    noise = _noise(runs, model)
    listed = _base(runs, model)
    chosen = _placed(runs, listed, noise, name, settings, sensors)
    return _grown(model, runs, noise, listed, chosen)


def grow(
    model: ThermalModel | None,
    runs: Sequence[PreparedRun],
    settings: Settings,
    report: Callable[[str], None] = lambda _: None,
    *,
    named_only: bool = False,
) -> Growth:
    """Diagnose and add the strongest effect, again and again, until nothing can be named.

    What is left is described by the empirical term where that lowers the held-out error by more
    than chance; not with `named_only`.
    """
    noise = _noise(runs, model)
    steps: list[Step] = []
    first: Comparison | None = None
    current, growth = model, None
    while True:
        report('diagnosing …')
        diagnosis = diagnose_prepared(runs, current, settings)
        found = next((f for f in diagnosis.findings if f.kind == 'effect'), None)
        if found is None or len(steps) == MOST_STEPS:
            break
        report(f'adding {found.name} …')
        names = [s for s in noise if s in found.sensor.split('+')]
        listed = _base(runs, current)
        assert found.name is not None  # noqa: S101 (findings of kind effect have one)
        chosen = _placed(runs, listed, noise, found.name, settings, names)
        growth = _grown(current, runs, noise, listed, chosen, found.ambiguous_with)
        first = first or growth.before
        steps += growth.steps
        current = growth.model
        noise = _noise(runs, current)
    if not named_only:
        report('looking for what repeats without a name …')
        further = _empirical(current, runs, noise)
        if further is not None:
            growth, first = further, first or further.before
            steps += further.steps
            current = growth.model
    if growth is None or first is None:
        fitted = fit_prepared(_base(runs, model), runs, noise=noise)
        if model is not None:
            fitted = model.succeeded_by(fitted)
        compared = compare_prepared(fitted, runs, noise=noise)
        return Growth(fitted, compared, compared, (), (), diagnosis)
    return Growth(growth.model, first, growth.after, tuple(steps), growth.unneeded, diagnosis)


def _empirical(
    model: ThermalModel | None, runs: Sequence[PreparedRun], noise: Mapping[Sensor, NoiseModel]
) -> Growth | None:
    """Return the model with the empirical term where held-out parts confirm it; None: nowhere."""
    listed = _base(runs, model)
    chosen: dict[Sensor, Effect] = {}
    for sensor, effects in listed.items():
        known = [e for e in effects if not isinstance(e, Empirical)]
        form = empirical_form(runs, sensor, known, noise[sensor]) if sensor in noise else None
        if form is None or len(known) < len(effects) or any(e.coupled for e in known):
            continue
        alone = {sensor: noise[sensor]}
        before = hold_out(runs, {sensor: effects}, alone)
        if before.falls_to(hold_out(runs, {sensor: (*effects, form)}, alone), sensor):
            chosen[sensor] = form
    if not chosen:
        return None
    grown = _grown(model, runs, noise, listed, chosen)
    steps = tuple(
        replace(
            grown.steps[0],
            sensors=(sensor,),
            error_before=_rms([grown.before.sensors[sensor].held_out_rms]),
            error_after=_rms([grown.after.sensors[sensor].held_out_rms]),
            noise_floor=_rms([grown.after.sensors[sensor].noise_floor]),
            empirical=True,
        )
        for sensor in chosen
    )
    return replace(grown, steps=steps)


def _noise(runs: Sequence[PreparedRun], model: ThermalModel | None) -> dict[Sensor, NoiseModel]:
    return determined_noise(runs, _base(runs, model))[0]


def _base(runs: Sequence[PreparedRun], model: ThermalModel | None) -> Listed:
    return {sensor: base_effects(model, sensor) for sensor in usable_sensors(runs)[0]}


def _placed(
    runs: Sequence[PreparedRun],
    listed: Listed,
    noise: Mapping[Sensor, NoiseModel],
    name: str,
    settings: Settings,
    sensors: Sequence[Sensor],
) -> dict[Sensor, Effect]:
    """Return the best form of the effect for each sensor it goes to."""
    source = ColumnSource(runs)
    effect = settings.catalogue[name]
    wanted = [s for s in (sensors or noise) if s in effect.sensors and s in noise]
    if not wanted:
        raise ModelError(
            f'{name} acts on {", ".join(effect.sensors)}, not on {", ".join(sensors or noise)}'
        )
    scored = {}
    for sensor in wanted:
        design = CandidateDesign(source, sensor, noise[sensor], listed[sensor])
        search = Search(design, families(design, {name: effect}), settings.thresholds)
        ranking = search.ranking([])
        if ranking:
            scored[sensor] = ranking[0]
    if not scored:
        raise ModelError(f'{name} leaves no trace in these runs that could be fitted')
    needed = threshold_of(effect, settings.thresholds)
    strong = [s for s, r in scored.items() if r.evidence >= needed]
    best = max(scored, key=lambda s: scored[s].evidence)
    if effect.coupled:
        return {s: scored[best].form.effect for s in effect.sensors if s in noise}
    chosen = list(scored) if sensors else strong or [best]
    return {s: scored[s].form.effect for s in chosen}


def _grown(
    model: ThermalModel | None,
    runs: Sequence[PreparedRun],
    noise: Mapping[Sensor, NoiseModel],
    listed: Listed,
    chosen: Mapping[Sensor, Effect],
    ambiguous_with: tuple[str, ...] = (),
) -> Growth:
    new: Listed = {
        s: joined_effects([*effects, *([chosen[s]] if s in chosen else [])])
        for s, effects in listed.items()
    }
    plain = fit_prepared(listed, runs, noise=noise, refine=False)
    grown = fit_prepared(new, runs, noise=noise)
    after = compare_prepared(grown, runs)
    before = compare_prepared(plain, runs, noise=noise)
    effect = next(iter(chosen.values()))
    named = tuple(chosen)
    step = Step(
        effect.name,
        named,
        _rms([before.sensors[s].held_out_rms for s in named[:1]]),
        _rms([after.sensors[s].held_out_rms for s in named[:1]]),
        _rms([after.sensors[s].noise_floor for s in named[:1]]),
        ambiguous_with,
    )
    history = (model or plain).succeeded_by(grown)
    return Growth(history, before, after, (step,), _unneeded(runs, grown, noise, effect.name))


def _unneeded(
    runs: Sequence[PreparedRun],
    model: ThermalModel,
    noise: Mapping[Sensor, NoiseModel],
    added: str,
) -> tuple[str, ...]:
    """Return the earlier terms that bring no evidence beside the others."""
    source = ColumnSource(runs)
    found = []
    for sensor in noise:
        effects = model.sensors[sensor].effects
        regularised = any(e.coefficient_deviations() is not None for e in effects)
        if added not in {e.name for e in effects} or regularised:
            continue
        design = CandidateDesign(source, sensor, noise[sensor], [])
        terms = dict(zip(effects, design.terms(effects), strict=True))
        everything = design.solve(list(terms.values()))
        for effect in effects:
            others = [term for e, term in terms.items() if e is not effect]
            delta_chi2, rank = design.solve(others)
            lost = everything[0] - delta_chi2 - (everything[1] - rank) * float(np.log(design.rows))
            if effect.name != added and lost < 0.0:
                found.append(f'{sensor}: {effect.name}')
    return tuple(found)


def _rms(per_axis: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.square(np.concatenate(per_axis)))))
