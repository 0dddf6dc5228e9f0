# SPDX-License-Identifier: Apache-2.0
"""Add the effect that a diagnosis names, or one that cannot be told from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from thermal_comp.comparison.compare import rms_of
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.evidence.candidates import missing_channels
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.diagnosis.evidence.priors import NOTHING_PROBABILITY
from thermal_comp.diagnosis.evidence.set_search import best_single
from thermal_comp.diagnosis.grown_model import (
    Growth,
    effects_by_sensor,
    error_rises,
    with_effects,
)
from thermal_comp.diagnosis.result import Finding
from thermal_comp.diagnosis.sensor_search import Listed, Settings
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.model.values import ModelError, NoiseModel, ThermalModel

LEAST_LOG_GAIN = 0.01
"""Fall of ln of the held-out error by which a less likely effect stands in place of one that it
cannot be told from."""

DiagnosedForms = Mapping[tuple[Sensor, str], Effect]
"""Effects by sensor and name, in the form that a diagnosis found."""


def with_named_effect(
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
        if error_rises(grown, grown.steps[-1].sensors):
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
    listed = effects_by_sensor(runs, model)
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
                chosen = forms_by_sensor(runs, listed, noise, name, settings, sensors)
            except ModelError:  # beside what was added since it leaves no trace
                continue
        others = tuple(other for other in names if other != name)
        placed = {s: (form,) for s, form in chosen.items()}
        grown = with_effects(model, runs, noise, listed, placed, others)
        if best is None or _log_error(grown, sensors) < _log_error(best, sensors) - LEAST_LOG_GAIN:
            best = grown
    return best


def _log_error(grown: Growth, sensors: Sequence[Sensor]) -> float:
    """Return the sum over sensors of ln of the held-out error of a grown model."""
    return sum(float(np.log(rms_of(grown.after.sensors[s].held_out_rms))) for s in sensors)


def forms_by_sensor(
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
