# SPDX-License-Identifier: Apache-2.0
"""Let a model grow: add what is missing, refit everything together, watch the error fall."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from thermal_comp.comparison.compare import (
    Comparison,
    SensorComparison,
    compare_prepared,
    rms_of,
)
from thermal_comp.comparison.simpler import LEAST_SURE_RISE, raised, worse_than_simpler
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.improvement import falls_enough, in_floors, may_fall
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.diagnose import Settings, base_effects, diagnose_prepared
from thermal_comp.diagnosis.evidence.candidates import missing_channels
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.diagnosis.evidence.priors import NOTHING_PROBABILITY
from thermal_comp.diagnosis.evidence.set_search import best_single
from thermal_comp.diagnosis.grown_model import Growth, Step, step_of
from thermal_comp.diagnosis.model_form import with_model_form
from thermal_comp.diagnosis.result import Diagnosis, Finding
from thermal_comp.diagnosis.sensor_answer import UNNAMED_CAUSES
from thermal_comp.diagnosis.sensor_search import Listed
from thermal_comp.effects.effect import Effect, joined_effects
from thermal_comp.fitting.empirical import empirical_form
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.fitting.inputs import usable_sensors
from thermal_comp.fitting.prediction import best_held_out, predictive_effects
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.model.values import (
    ModelError,
    NoiseModel,
    Provenance,
    ThermalModel,
)
from thermal_comp.noise.of_runs import determined_noise

MOST_STEPS = 6
"""Effects added before growing stops."""
LEAST_LOG_GAIN = 0.01
"""Fall of ln of the held-out error by which a less likely effect stands in place of one that it
cannot be told from."""

DiagnosedForms = Mapping[tuple[Sensor, str], Effect]
"""Effects by sensor and name, in the form that a diagnosis found."""


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
    noise = _noise_of(runs, model)
    listed = _base(runs, model)
    chosen = _forms_by_sensor(runs, listed, noise, name, settings, sensors)
    growth = _with_effects(model, runs, noise, listed, {s: (e,) for s, e in chosen.items()})
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
    noise = weights = _noise_of(runs, model)
    steps: list[Step] = []
    first: Comparison | None = None
    current, growth = model, None
    while True:
        report('diagnosing …')
        diagnosis = diagnose_prepared(runs, current, settings)
        named, before = [f for f in diagnosis.findings if f.kind == 'effect'], len(steps)
        forms = {(ranked.sensor, ranked.name): ranked.effect for ranked in diagnosis.ranking}
        while named and len(steps) < MOST_STEPS:
            added, named = _with_named_effect(current, runs, noise, settings, named, forms, report)
            if added is None or (len(steps) > before and not added.steps[-1].lowered):
                break  # the next diagnosis tells whether what lowers nothing is needed
            growth = added
            first = first or growth.before
            steps += growth.steps
            current, weights = growth.model, noise
            noise = _noise_of(runs, current)
        if len(steps) == before:
            break
    if not named_only:
        report('looking for what repeats without a name …')
        further = _with_predictive_terms(current, _base(runs, model), runs, settings, diagnosis)
        if further is not None:
            growth, first = further, first or further.before
            steps += further.steps
            current = growth.model
    if growth is None or first is None:
        fitted = fit_prepared(_base(runs, model), runs, noise=noise)
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


def _with_named_effect(
    model: ThermalModel | None,
    runs: Sequence[PreparedRun],
    noise: Mapping[Sensor, NoiseModel],
    settings: Settings,
    named: Sequence[Finding],
    forms: DiagnosedForms,
    report: Callable[[str], None],
) -> tuple[Growth | None, list[Finding]]:
    """Return the model with the strongest effect that lowers the error, and the findings left.

    What lowers it by no more than chance waits for the others: beside them it may be needless.
    What raises it is left out.
    """
    waiting: list[tuple[Growth, Finding]] = []
    for number, found in enumerate(named):
        grown = _with_best_of_alike(model, runs, noise, settings, found, forms, report)
        if grown is None:
            continue
        if held_out_error_rises(grown, grown.steps[-1].sensors):
            report(f'{found.name} ({found.sensor}) raises the held-out error: left out')
        elif grown.steps[-1].lowered:
            return grown, [*(f for _, f in waiting), *named[number + 1 :]]
        else:
            waiting.append((grown, found))
    if not waiting:
        return None, []
    return waiting[0][0], [f for _, f in waiting[1:]]


def _with_best_of_alike(
    model: ThermalModel | None,
    runs: Sequence[PreparedRun],
    noise: Mapping[Sensor, NoiseModel],
    settings: Settings,
    found: Finding,
    forms: DiagnosedForms,
    report: Callable[[str], None],
) -> Growth | None:
    """Return the model with a named effect, or with one that cannot be told from it.

    The one with the smallest held-out error; of equals the likeliest. One that was not named needs
    no channel, which the field may lack. None: the effect is there already.
    """
    listed = _base(runs, model)
    sensors = [s for s in noise if s in found.sensor.split('+')]
    there = {effect.name for s in sensors for effect in listed[s] if not effect.repeatable}
    names = [name for name in (found.name, *found.ambiguous_with) if name is not None]
    best: Growth | None = None
    for name in names if found.name not in there else ():
        effect = settings.catalogue.get(name)
        if effect is None or name in there or missing_channels(effect, runs):
            continue
        acts_here = set(sensors) <= set(effect.sensors)
        if name != found.name and (effect.coupled or effect.channels or not acts_here):
            continue
        report(f'adding {name} …')
        if name == found.name and all((s, name) in forms for s in sensors):
            chosen = {s: forms[s, name] for s in sensors}
        else:
            try:
                chosen = _forms_by_sensor(runs, listed, noise, name, settings, sensors)
            except ModelError:  # beside what was added since it leaves no trace
                continue
        others = tuple(other for other in names if other != name)
        placed = {s: (form,) for s, form in chosen.items()}
        grown = _with_effects(model, runs, noise, listed, placed, others)
        if best is None or _log_error(grown, sensors) < _log_error(best, sensors) - LEAST_LOG_GAIN:
            best = grown
    return best


def _log_error(grown: Growth, sensors: Sequence[Sensor]) -> float:
    """Return the sum over sensors of ln of the held-out error of a grown model."""
    return sum(float(np.log(rms_of(grown.after.sensors[s].held_out_rms))) for s in sensors)


def held_out_error_rises(grown: Growth, sensors: Sequence[Sensor]) -> bool:
    """Tell whether the held-out error rises in all sensors, or on an axis by what is no chance."""
    pairs = [(grown.before.sensors[s], grown.after.sensors[s]) for s in sensors]
    axes = (after.held_out_rms > LEAST_SURE_RISE * before.held_out_rms for before, after in pairs)
    return any(axis.any() for axis in axes) or all(raised(*pair) for pair in pairs)


def _with_predictive_terms(
    model: ThermalModel | None,
    first: Listed,
    runs: Sequence[PreparedRun],
    settings: Settings,
    diagnosis: Diagnosis,
) -> Growth | None:
    """Return the model with what lowers the held-out error, cause undecided; None: nothing.

    What the diagnosis thinks possible is tried beside what forward selection finds, and what it
    finds beside the `first` effects in place of those that were named since, in sensors that still
    lack something: names that leave nothing to explain stand.
    """
    listed, noise = _base(runs, model), _noise_of(runs, model)
    tried = [s for s in noise if not any(_shared_or_empirical(e) for e in listed[s])]
    kept: dict[Sensor, tuple[Effect, ...]] = {}
    beside: dict[Sensor, tuple[Effect, ...]] = dict(listed)
    offered = {name for name, effect in settings.catalogue.items() if not effect.coupled}
    missing = [f for f in diagnosis.findings if f.kind in ('effect', *UNNAMED_CAUSES)]
    lacking = {sensor for finding in missing for sensor in finding.sensor.split('+')}
    for s in tried:
        said = [e.names for e in diagnosis.explanations if e.sensor == s]
        own = (tuple(name for name in names if name in offered) for names in said)
        possible = [names for names in own if names]
        choose = partial(predictive_effects, runs, s, noise=noise[s], catalogue=settings.catalogue)
        kept[s] = listed[s]
        beside[s] = (*listed[s], *choose(listed[s], candidates=possible))
        if s in lacking and len(listed[s]) > len(first[s]):
            other = _in_place_of_named(runs, s, beside[s], first[s], choose)
            if other:
                kept[s], beside[s] = first[s], other
    changed = [s for s in tried if beside[s] != listed[s]]
    if changed:
        fitted = fit_prepared(beside, runs, noise=noise)
        # The shapes that fit all rows best may be worse on parts that no fit has seen.
        for s in listed:
            forms = (fitted.sensors[s].effects, beside[s])
            beside[s] = best_held_out(runs, s, forms, noise[s]) if s in changed else forms[0]
        noise = determined_noise(runs, beside)[0]
    terms = {s: empirical_form(runs, s, beside[s], noise[s]) for s in tried if s in noise}
    added = {
        s: (*beside[s][len(kept[s]) :], *([term] if (term := terms.get(s)) else [])) for s in tried
    }
    added = {s: effects for s, effects in added.items() if effects}
    if not added:
        return None
    grown = _with_effects(model, runs, noise, listed, added, kept=kept, empirical=True)
    good = {s: effects for s, effects in added.items() if not held_out_error_rises(grown, [s])}
    if len(good) < len(added):  # refitted together they do not keep what they promised
        if not good:
            return None
        return _with_effects(model, runs, noise, listed, good, kept=kept, empirical=True)
    return grown


def _in_place_of_named(
    runs: Sequence[PreparedRun],
    sensor: Sensor,
    named: tuple[Effect, ...],
    first: tuple[Effect, ...],
    choose: Callable[[tuple[Effect, ...]], tuple[Effect, ...]],
) -> tuple[Effect, ...]:
    """Return effects chosen beside the first that leave less on held-out parts than named ones.

    (): none do, or what the named ones leave is no more than noise.
    """

    def left(effects: tuple[Effect, ...]) -> SensorComparison:
        noise = determined_noise(runs, {sensor: effects})[0]
        fitted = fit_prepared({sensor: effects}, runs, noise=noise)
        return compare_prepared(fitted, runs).sensors[sensor]

    before = left(named)
    floor = before.noise_floor**2
    if not may_fall(before.held_out_squares, floor) or not (other := choose(first)):
        return ()
    after = left((*first, *other))
    sums = (in_floors(one.held_out_squares, floor).sum() for one in (before, after))
    return (*first, *other) if falls_enough(*sums) else ()


def _shared_or_empirical(effect: Effect) -> bool:
    return effect.coupled or not effect.names_cause


def _noise_of(runs: Sequence[PreparedRun], model: ThermalModel | None) -> dict[Sensor, NoiseModel]:
    return determined_noise(runs, _base(runs, model))[0]


def _base(runs: Sequence[PreparedRun], model: ThermalModel | None) -> Listed:
    return base_effects(model, usable_sensors(runs)[0])


def _forms_by_sensor(
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
        hypotheses = SensorHypotheses(design, {name: effect})
        if hypotheses.families:
            scored[sensor] = best_single(hypotheses, hypotheses.families[0])
    if not scored:
        raise ModelError(f'{name} leaves no trace in these runs that could be fitted')
    strong = [s for s, r in scored.items() if r.log_posterior > np.log(NOTHING_PROBABILITY)]
    best = max(scored, key=lambda s: scored[s].log_posterior)
    forms = {s: r.components[0].form.effect for s, r in scored.items()}
    if effect.coupled:
        return {s: forms[best] for s in effect.sensors if s in noise}
    chosen = list(scored) if sensors else strong or [best]
    return {s: forms[s] for s in chosen}


def _with_effects(
    model: ThermalModel | None,
    runs: Sequence[PreparedRun],
    noise: Mapping[Sensor, NoiseModel],
    listed: Listed,
    chosen: Mapping[Sensor, Sequence[Effect]],
    ambiguous_with: tuple[str, ...] = (),
    *,
    kept: Listed | None = None,
    empirical: bool = False,
) -> Growth:
    """Return the model with the chosen effects; `empirical`: a step a sensor, shapes stand.

    They stand beside those `kept`, or beside all.
    """
    stay = {
        s: (kept or {}).get(s, effects) if s in chosen else effects
        for s, effects in listed.items()
    }
    new: Listed = {
        s: joined_effects([*effects, *chosen.get(s, ())]) for s, effects in stay.items()
    }
    plain = fit_prepared(listed, runs, noise=noise, refine=False)
    grown = fit_prepared(new, runs, noise=noise, refine=not empirical)
    after = compare_prepared(grown, runs)
    before = compare_prepared(plain, runs, noise=noise)
    taken = {s: [e.name for e in effects[len(stay[s]) :]] for s, effects in listed.items()}
    put = {s: [e.name for e in effects] for s, effects in chosen.items()}
    names = {s: ' + '.join(n for n in own if n not in taken[s]) for s, own in put.items()}
    replaced = {s: tuple(n for n in taken[s] if n not in own) for s, own in put.items()}
    if empirical:
        grown = replace(grown, provenance=_with_note(grown.provenance, names))
    groups = [(s,) for s in chosen] if empirical else [tuple(chosen)]
    steps = tuple(
        step_of(
            before.sensors[g[0]],
            after.sensors[g[0]],
            names[g[0]],
            g,
            ambiguous_with,
            empirical,
            replaced[g[0]],
        )
        for g in groups
    )
    return Growth(
        model=(model or plain).succeeded_by(grown), before=before, after=after, steps=steps
    )


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


def _with_note(provenance: Provenance, names: Mapping[Sensor, str]) -> Provenance:
    """Return the provenance with a note on what was added without a cause."""
    notes = (
        f'{s}: {added} lowers the held-out error; cause undecided'
        for s, added in names.items()
        if added
    )
    return replace(provenance, notes=(*provenance.notes, *notes))


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
