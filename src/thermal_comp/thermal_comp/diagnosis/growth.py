# SPDX-License-Identifier: Apache-2.0
"""Let a model grow: add what is missing, refit everything together, watch the error fall."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from thermal_comp.comparison.compare import Comparison, compare_prepared, rms_of
from thermal_comp.comparison.simpler import raised, worse_than_simpler
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.diagnose import diagnose_prepared
from thermal_comp.diagnosis.evidence.candidates import missing_channels
from thermal_comp.diagnosis.grown_model import (
    Growth,
    Step,
    effects_by_sensor,
    noise_by_sensor,
    with_effects,
)
from thermal_comp.diagnosis.model_form import with_model_form
from thermal_comp.diagnosis.named_effects import forms_by_sensor, with_named_effect
from thermal_comp.diagnosis.sensor_search import Settings
from thermal_comp.diagnosis.undecided_terms import with_undecided_terms
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.model.values import ModelError, NoiseModel, ThermalModel

MOST_STEPS = 6
"""Effects added before growing stops."""


def add_effect(
    model: ThermalModel | None,
    runs: Sequence[PreparedRun],
    name: str,
    settings: Settings,
    sensors: Sequence[Sensor] = (),
    *,
    judged: bool = True,
) -> Growth:
    """Return the model with an effect added and everything refitted together.

    Without `sensors` the effect goes where it is likelier than nothing, else to the sensor where
    it is likeliest. `judged` False leaves open what became unneeded and where it is worse.
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
    noise = noise_by_sensor(runs, model)
    listed = effects_by_sensor(runs, model)
    chosen = forms_by_sensor(runs, listed, noise, name, settings, sensors)
    growth = with_effects(model, runs, noise, listed, {s: (e,) for s, e in chosen.items()})
    if not judged:
        return growth
    growth = _with_checks(growth, runs, noise)
    return replace(growth, worse=(*growth.worse, *raised_by(growth)))


def raised_by(growth: Growth) -> list[str]:
    """Return a sentence per sensor whose held-out error the last effect raises."""
    last = growth.steps[-1]
    found = []
    for sensor in last.sensors:
        before, after = growth.before.sensors[sensor], growth.after.sensors[sensor]
        if raised(before, after):
            ratio = rms_of(after.held_out_rms) / rms_of(before.held_out_rms)
            found.append(
                f'{sensor}: the error on held-out parts is {ratio:.2f} times that without '
                f'{last.added}'
            )
    return found


def grow(
    model: ThermalModel | None,
    runs: Sequence[PreparedRun],
    settings: Settings,
    report: Callable[[str], None] = lambda _: None,
    *,
    named_only: bool = False,
) -> Growth:
    """Diagnose and add the strongest effect, again and again, until nothing can be named.

    A name whose correction raises the held-out error is left out: a derivative may let more of the
    thermometer's noise through than it takes away. What is left is taken out by whatever lowers
    the held-out error by more than chance: effects whose cause is undecided, beside those named or
    in their place, then the empirical term; not with `named_only`.
    """
    noise = weights = noise_by_sensor(runs, model)
    steps: list[Step] = []
    first: Comparison | None = None
    current, growth = model, None
    while True:
        report('diagnosing …')
        diagnosis = diagnose_prepared(runs, current, settings)
        named, before = [f for f in diagnosis.findings if f.kind == 'effect'], len(steps)
        forms = {(ranked.sensor, ranked.name): ranked.effect for ranked in diagnosis.ranking}
        while named and len(steps) < MOST_STEPS:
            added, named = with_named_effect(current, runs, noise, settings, named, forms, report)
            if added is None or (len(steps) > before and not added.steps[-1].lowered):
                break  # the next diagnosis tells whether what lowers nothing is needed
            growth = added
            first = first or growth.before
            steps += growth.steps
            current, weights = growth.model, noise
            noise = noise_by_sensor(runs, current)
        if len(steps) == before:
            break
    if not named_only:
        report('looking for what repeats without a name …')
        further = with_undecided_terms(
            current, effects_by_sensor(runs, model), runs, settings, diagnosis
        )
        if further is not None:
            growth, first = further, first or further.before
            steps += further.steps
            current = growth.model
    if growth is None or first is None:
        fitted = fit_prepared(effects_by_sensor(runs, model), runs, noise=noise)
        if model is not None:
            fitted = model.succeeded_by(fitted)
        compared = compare_prepared(fitted, runs, noise=noise)
        worse = worse_than_simpler(fitted, compared, runs)
        return Growth(
            model=fitted,
            before=compared,
            after=compared,
            steps=(),
            unneeded=(),
            worse=worse,
            diagnosis=diagnosis,
        )
    growth = _with_checks(growth, runs, weights)
    return replace(growth, before=first, steps=tuple(steps), diagnosis=diagnosis)


def _with_checks(
    growth: Growth, runs: Sequence[PreparedRun], noise: Mapping[Sensor, NoiseModel]
) -> Growth:
    """Return a growth with what its last step made unneeded, and where it is worse.

    Its model's shape parameters are as uncertain as the forms of their effects.
    """
    last = growth.steps[-1]
    return replace(
        growth,
        model=with_model_form(growth.model, runs),
        unneeded=() if last.empirical else _unneeded(runs, growth.model, noise, last.added),
        worse=worse_than_simpler(growth.model, growth.after, runs),
    )


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
