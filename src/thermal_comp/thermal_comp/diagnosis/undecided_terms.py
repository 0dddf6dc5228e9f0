# SPDX-License-Identifier: Apache-2.0
"""Add what lowers the held-out error although no cause is decided."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from thermal_comp.comparison.compare import SensorComparison, compare_prepared
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.improvement import falls_enough, in_floors, may_fall
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.grown_model import (
    Growth,
    effects_by_sensor,
    error_rises,
    noise_by_sensor,
    with_effects,
)
from thermal_comp.diagnosis.result import Diagnosis
from thermal_comp.diagnosis.sensor_answer import UNNAMED_CAUSES
from thermal_comp.diagnosis.sensor_search import Listed, Settings
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.empirical import empirical_form
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.fitting.prediction import best_held_out, predictive_effects
from thermal_comp.fitting.weights import with_best_weights
from thermal_comp.model.values import ThermalModel
from thermal_comp.noise.of_runs import determined_noise


def with_undecided_terms(
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
    listed, noise = effects_by_sensor(runs, model), noise_by_sensor(runs, model)
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
        noise = with_best_weights(runs, beside, determined_noise(runs, beside)[0])
    terms = {s: empirical_form(runs, s, beside[s], noise[s]) for s in tried if s in noise}
    added = {
        s: (*beside[s][len(kept[s]) :], *([term] if (term := terms.get(s)) else [])) for s in tried
    }
    added = {s: effects for s, effects in added.items() if effects}
    if not added:
        return None
    grown = with_effects(model, runs, noise, listed, added, kept=kept, empirical=True)
    good = {s: effects for s, effects in added.items() if not error_rises(grown, [s])}
    if len(good) < len(added):  # refitted together they do not keep what they promised
        if not good:
            return None
        return with_effects(model, runs, noise, listed, good, kept=kept, empirical=True)
    return grown


def _in_place_of_named(
    runs: Sequence[PreparedRun],
    sensor: Sensor,
    named: tuple[Effect, ...],
    first: tuple[Effect, ...],
    choose: Callable[[tuple[Effect, ...]], tuple[Effect, ...]],
) -> tuple[Effect, ...]:
    """Return effects chosen beside the first that leave less on held-out parts than named ones.

    Whichever part is left out: a single one may be far from the others, as the end of a sweep is.
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
    parts = [in_floors(one.held_out_squares, floor) for one in (before, left((*first, *other)))]
    sums = [each.sum() - each if len(each) > 1 else each for each in parts]
    robust = all(falls_enough(*pair) for pair in zip(*sums, strict=True))
    return (*first, *other) if robust else ()


def _shared_or_empirical(effect: Effect) -> bool:
    return effect.coupled or not effect.names_cause
