# SPDX-License-Identifier: Apache-2.0
"""Diagnose a model: which physical effect is missing, that none is, or that none explains it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from imu_recording.recording import ImuRecording

from thermal_comp.comparison.compare import Comparison, compare_prepared, rms_of
from thermal_comp.comparison.simpler import raised
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.improvement import falls
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.change import changes, later_campaign
from thermal_comp.diagnosis.evidence.posterior import credible
from thermal_comp.diagnosis.findings import (
    Explained,
    clock_findings,
    effect_findings,
    noise_findings,
    quality_finding,
    ranked,
    ranked_effects,
    sensor_states,
    unnamed_findings,
)
from thermal_comp.diagnosis.identifiability import undecidable
from thermal_comp.diagnosis.inputs import DiagnosisInputs, prepare_inputs
from thermal_comp.diagnosis.model_form import with_model_form
from thermal_comp.diagnosis.noise_level import NoiseReference
from thermal_comp.diagnosis.result import Diagnosis, Finding, NamedExplanation, Prediction
from thermal_comp.diagnosis.sensor_answer import SensorAnswer
from thermal_comp.diagnosis.sensor_search import (
    Listed,
    Settings,
    greyed_out,
    named_beside,
    no_progress,
    search_sensors,
)
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect, joined_effects
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.fitting.inputs import check_temperature, usable_sensors
from thermal_comp.fitting.weights import notes_of_weights
from thermal_comp.model.values import NoiseModel, ThermalModel
from thermal_comp.noise.of_runs import determined_noise, noise_beside

__all__ = [
    'Settings',
    'base_effects',
    'diagnose',
    'diagnose_inputs',
    'diagnose_prepared',
    'greyed_out',
]


def diagnose(
    recordings: Iterable[ImuRecording],
    model: ThermalModel | None = None,
    *,
    catalogue: Mapping[str, type[Effect]] | None = None,
    reference: NoiseReference | None = None,
    period: float | None = None,
) -> Diagnosis:
    """Return what is missing in the model, in the light of recordings of one device.

    Recordings that are read only when they are needed are read one at a time, and none is kept.
    Without a model the line per axis is fitted first.
    """
    inputs = prepare_inputs(recordings, period=period)
    return diagnose_inputs(inputs, model, catalogue or EFFECTS, reference)


def diagnose_inputs(
    inputs: DiagnosisInputs,
    model: ThermalModel | None,
    catalogue: Mapping[str, type[Effect]],
    reference: NoiseReference | None = None,
    progress: Callable[[str, float], None] = no_progress,
) -> Diagnosis:
    """Return the diagnosis of recordings that are checked and prepared, their defects included.

    `progress` is called with what is being done and the share of all that is done.
    """
    settings = Settings(catalogue, reference, inputs.bandwidth_known, progress)
    diagnosis = diagnose_prepared(inputs.runs, model, settings)
    findings = [
        *(quality_finding(defect) for defect in inputs.defects),
        *clock_findings(inputs.clock),
        *diagnosis.findings,
    ]
    return replace(diagnosis, findings=ranked(findings))


def diagnose_prepared(
    runs: Sequence[PreparedRun], model: ThermalModel | None, settings: Settings
) -> Diagnosis:
    """Return the diagnosis of prepared runs; the data are taken as sound."""
    check_temperature(runs)
    sensors, notes = usable_sensors(runs)
    refined = _refined(model, sensors, runs)
    noise, short = determined_noise(runs, base_effects(refined, sensors))
    base: Listed = base_effects(refined, noise)
    answers = search_sensors(runs, base, noise, settings)
    noise = noise_beside(runs, named_beside(base, answers), noise)
    fitted = fit_prepared(base, runs, noise=noise, refine=False)
    current = compare_prepared(fitted, runs, noise=noise)
    explained = _explained(runs, base, answers, noise, fitted)
    changed = _changed(model, refined, runs, current)
    loud = noise_findings(
        noise,
        current,
        settings.reference,
        duration=sum(len(run) * run.period for run in runs),
        bandwidth_known=settings.bandwidth_known,
    )
    lacking = [f for s, a in answers.items() for f in _lacking(s, a, current, explained)]
    unnamed = any(finding.kind in {'unexplained', 'unlogged'} for finding in lacking)
    apart = later_campaign(runs) if unnamed else ''
    return Diagnosis(
        device=current.device,
        findings=ranked([*changed, *lacking, *loud.values()]),
        sensors=sensor_states(answers, current, loud, changed),
        greyed_out=greyed_out(runs, settings.catalogue),
        predictions=_predictions(base, answers, current, explained),
        undetermined=explained.undetermined,
        undecided=undecidable(runs, base, noise, settings.catalogue),
        notes=(*current.notes, *notes, *short, *([apart] if apart else [])),
        explanations=_credible_explanations(answers),
        ranking=ranked_effects(answers),
    )


def _refined(
    model: ThermalModel | None, sensors: Sequence[Sensor], runs: Sequence[PreparedRun]
) -> ThermalModel | None:
    """Return the model with its effects fitted to these runs; itself where it comes from them."""
    hashes = {run.hash for run in runs}
    if model is None or set(model.provenance.sources.values()) >= hashes:
        return model
    return fit_prepared(base_effects(model, sensors), runs)


def _changed(
    stored: ThermalModel | None,
    refined: ThermalModel | None,
    runs: Sequence[PreparedRun],
    current: Comparison,
) -> list[Finding]:
    """Return the findings about stored coefficients that are others in these runs."""
    if stored is None or refined is None or stored is refined:
        return []
    return changes(stored, refined, runs, current)


def _lacking(
    sensor: Sensor, answer: SensorAnswer, current: Comparison, explained: Explained
) -> list[Finding]:
    """Return the findings about what the model of one sensor lacks, with a name or without."""
    named = effect_findings(sensor, answer, current, explained)
    return [*named, *unnamed_findings(sensor, answer, current)]


def _credible_explanations(answers: Mapping[Sensor, SensorAnswer]) -> tuple[NamedExplanation, ...]:
    """Return the fewest explanations of each sensor that hold its probability."""
    return tuple(
        NamedExplanation(e.names, sensor, e.probability, e.approximate, e.depends_on)
        for sensor, answer in answers.items()
        for e in credible(answer.with_coupled)
    )


def base_effects(model: ThermalModel | None, sensors: Iterable[Sensor]) -> Listed:
    """Return by sensor the effects of the model that is diagnosed; without one a line per axis."""
    known = model.sensors if model else {}
    return {s: known[s].effects if s in known else (BiasTemperature(),) for s in sensors}


def _explained(
    runs: Sequence[PreparedRun],
    base: Listed,
    answers: Mapping[Sensor, SensorAnswer],
    noise: Mapping[Sensor, NoiseModel],
    fitted: ThermalModel,
) -> Explained:
    """Return the base fitted with all that was named, and what is closest where nothing was.

    `fitted` is the base alone.
    """
    listed = named_beside(base, answers)
    coupled = {e for effects in listed.values() for e in effects if e.coupled}
    for effect in coupled:
        for sensor in listed:
            if sensor in effect.sensors and effect not in listed[sensor]:
                listed[sensor] = (*listed[sensor], effect)
    closest = {s: joined_effects([*base[s], *a.closest]) for s, a in answers.items() if a.closest}
    listed |= closest
    if all(listed[s] == base[s] for s in listed):
        return Explained(None, None, ())
    named = [sensor for sensor, answer in answers.items() if answer.named]
    model = with_model_form(fit_prepared(listed, runs, noise=noise), runs, named)
    comparison = compare_prepared(model, runs)
    weights = {s: part.noise for s, part in model.sensors.items() if part.noise is not None}
    before = {*fitted.provenance.notes, *notes_of_weights(weights)}
    told = tuple(f'{sensor}:' for sensor in closest)
    new = tuple(
        note
        for note in model.provenance.notes
        if note not in before and not (told and note.startswith(told))
    )
    return Explained(model, comparison, new)


def _predictions(
    base: Listed,
    answers: Mapping[Sensor, SensorAnswer],
    current: Comparison,
    explained: Explained,
) -> tuple[Prediction, ...]:
    """Return what each sensor's correction would leave; none where it does not lower the error.

    Where nothing is missing but the thermometer errs, the error has to fall by more than chance.
    """
    made = []
    for sensor, answer in answers.items():
        before, after = current.sensors[sensor], current.sensors[sensor]
        terms: tuple[str, ...] = ()
        complete = answer.kind == 'complete'
        if explained.model is not None and explained.comparison is not None:
            grown = explained.comparison.sensors[sensor]
            squares = before.held_out_squares, grown.held_out_squares, grown.noise_floor**2
            if falls(*squares) if complete else not raised(before, grown):
                after = grown
                known = len(base[sensor])
                terms = tuple(e.name for e in explained.model.sensors[sensor].effects[known:])
        made.append(
            Prediction(
                sensor,
                terms,
                rms_of(before.held_out_rms),
                rms_of(after.held_out_rms),
                rms_of(after.noise_floor),
                empirical=bool(answer.closest) and (bool(terms) or not complete),
            )
        )
    return tuple(made)
