# SPDX-License-Identifier: Apache-2.0
"""Diagnose a model: which physical effect is missing, that none is, or that none explains it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording

from thermal_comp.comparison.compare import compare_prepared
from thermal_comp.data.conditions import CHANNELS, SENSORS, Sensor
from thermal_comp.data.preparation import PERIOD, PreparedRun
from thermal_comp.diagnosis.candidates import families, missing_channels
from thermal_comp.diagnosis.decision import Outcome, decide_confirmed
from thermal_comp.diagnosis.findings import (
    Explained,
    effect_findings,
    noise_finding,
    quality_finding,
    sensor_state,
    unnamed_findings,
    with_verdict,
)
from thermal_comp.diagnosis.generic_regressors import judges
from thermal_comp.diagnosis.identifiability import undecidable
from thermal_comp.diagnosis.inputs import prepare_inputs
from thermal_comp.diagnosis.result import Diagnosis, Finding, SensorState
from thermal_comp.diagnosis.search import Search, least_gains
from thermal_comp.diagnosis.thresholds import calibrated_thresholds
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import LEAST_EVIDENCE, Effect, joined_effects
from thermal_comp.fitting.fit import fit_prepared, usable_sensors
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.model.values import NoiseModel, ThermalModel
from thermal_comp.noise.of_runs import determined_noise, noise_beside

REFUTED = 20.0
"""χ² against an effect of several sensors from which no flaw in its form excuses it …"""
REFUTED_SHARE = 2e-4
"""… or this share of what it explains: the larger it is, the more a flaw in its form costs."""
CHANGED = 0.8
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
    """Whether white noise may be judged."""


def diagnose(
    recordings: Iterable[ImuRecording],
    model: ThermalModel | None = None,
    *,
    catalogue: Mapping[str, type[Effect]] | None = None,
    reference: Mapping[str, NoiseModel] | None = None,
    calibrate: int = 0,
    period: float = PERIOD,
) -> Diagnosis:
    """Return what is missing in the model, in the light of recordings of one device.

    Recordings that are read only when they are needed are read one at a time, and none is kept.
    Without a model the line per axis is fitted first. `calibrate` simulates that many campaigns
    without any effect under the fitted noise and raises the thresholds to what they reach.
    """
    inputs = prepare_inputs(recordings, period=period)
    runs, clock = inputs.runs, inputs.clock
    settings = Settings(catalogue or EFFECTS, None, reference, inputs.bandwidth_known)
    if calibrate:
        base = {sensor: base_effects(model, sensor) for sensor in SENSORS}
        thresholds = calibrated_thresholds(runs, base, settings.catalogue, calibrate)
        settings = replace(settings, thresholds=thresholds)
    diagnosis = diagnose_prepared(runs, model, settings)
    findings = [quality_finding(defect) for defect in inputs.defects]
    if clock is not None and clock.evidence > LEAST_EVIDENCE:
        slope = {'value': clock.slope, 'std': clock.slope_std, 'unit': '1/K'}
        findings.append(
            Finding(
                'effect',
                'clock_temperature',
                'all',
                clock.evidence,
                LEAST_EVIDENCE,
                error_before=clock.rms_before,
                error_after=clock.rms_after,
                unit='1',
                parameters={'slope': slope},
                text=f'the sampling interval changes by {clock.slope * 1e6:.1f} ppm/K',
            )
        )
    together = [*findings, *diagnosis.findings]
    ordered = sorted(together, key=lambda f: (f.kind == 'noise', -f.evidence))
    return replace(diagnosis, findings=tuple(ordered))


def diagnose_prepared(
    runs: Sequence[PreparedRun], model: ThermalModel | None, settings: Settings
) -> Diagnosis:
    """Return the diagnosis of prepared runs; the data are taken as sound."""
    sensors, notes = usable_sensors(runs)
    noise, short = determined_noise(runs, {s: base_effects(model, s) for s in sensors})
    base: Listed = {sensor: base_effects(model, sensor) for sensor in noise}
    outcomes = search_sensors(runs, base, noise, settings)
    noise = noise_beside(runs, named_beside(base, outcomes), noise)
    current = compare_prepared(
        fit_prepared(base, runs, noise=noise, refine=False), runs, noise=noise
    )
    findings: list[Finding] = []
    explained = _explained(runs, base, outcomes, noise)
    for sensor, outcome in outcomes.items():
        findings += effect_findings(sensor, outcome, current, explained, settings.thresholds)
        findings += unnamed_findings(sensor, outcome, current)
    states: dict[str, SensorState] = {s: sensor_state(s, outcomes[s], current) for s in noise}
    for sensor in noise:
        above = noise_finding(
            sensor,
            noise[sensor],
            current,
            (settings.reference or {}).get(sensor),
            bandwidth_known=settings.bandwidth_known,
        )
        if above is not None:
            findings.append(above)
            if states[sensor].verdict == 'complete':
                states[sensor] = with_verdict(states[sensor], 'noise_above_reference')
    ordered = sorted(findings, key=lambda f: (f.kind == 'noise', -f.evidence))
    return Diagnosis(
        device=current.device,
        findings=tuple(ordered),
        sensors=states,
        greyed_out=greyed_out(runs, settings.catalogue),
        undetermined=explained.undetermined,
        undecided=undecidable(runs, base, outcomes, noise, settings.catalogue),
        notes=(*current.notes, *notes, *short),
    )


def base_effects(model: ThermalModel | None, sensor: Sensor) -> tuple[Effect, ...]:
    """Return the effects of the model that is diagnosed; the line per axis without one."""
    if model is None or sensor not in model.sensors:
        return (BiasTemperature(),)
    return model.sensors[sensor].effects


def search_sensors(
    runs: Sequence[PreparedRun],
    base: Listed,
    noise: Mapping[Sensor, NoiseModel],
    settings: Settings,
) -> dict[Sensor, Outcome]:
    """Return what is said about each sensor.

    An effect that several sensors feel (a fixture that tilts turns gravity and field alike) is
    looked for in the first of them; where that may have found it the others are asked, and one
    that is found is taken as known for them. What is named and had been taken for noise (a step,
    a line) has the search begin anew, with the noise beside it.
    """
    source = ColumnSource(runs)
    missing = [c for c in CHANNELS if not any(run.conditions.has(c) for run in runs)]
    untried = greyed_out(runs, settings.catalogue)

    def search(sensor: Sensor, known: tuple[Effect, ...], **support: float) -> Found:
        found = search_under(noise[sensor], sensor, known, **support)
        named = named_beside({sensor: known}, {sensor: found[1]})
        beside = noise_beside(runs, named, noise)[sensor]
        if _quieter(beside, noise[sensor]):
            found = search_under(beside, sensor, known, **support)
        return found

    def search_under(
        weights: NoiseModel, sensor: Sensor, known: tuple[Effect, ...], **support: float
    ) -> Found:
        bank = CandidateDesign(source, sensor, weights, known)
        offered = {
            name: effect
            for name, effect in settings.catalogue.items()
            if name not in {e.name for e in known if not e.repeatable}
            and not (effect.coupled and sensor != effect.sensors[0] and len(base) > 1)
        }
        least = least_gains(source, sensor, weights, known, settings.catalogue)
        found = Search(
            bank,
            families(bank, offered),
            settings.thresholds,
            support=support,
            untried=frozenset(name for name in offered if name in untried),
            least_gains=least,
        )
        return bank, decide_confirmed(found, judges(bank), missing, known)

    # Most of the work is done in numpy and compiled loops, where sensors do not wait for another.
    with ThreadPoolExecutor() as pool:
        together = dict(zip(base, pool.map(search, base, base.values()), strict=True))
    outcomes = {sensor: outcome for sensor, (_, outcome) in together.items()}
    for effect in settings.catalogue.values():
        asked = [sensor for sensor in effect.sensors if sensor in outcomes]
        if not effect.coupled or len(asked) < 2 or not _may_be(effect, outcomes[asked[0]]):
            continue
        first, *others = asked
        support = coupled_support(effect(), [(together[s][0], outcomes[s]) for s in asked])
        _, outcomes[first] = search(first, base[first], **{effect.name: support})
        found = [n.rated.form.effect for n in outcomes[first].named if n.rated.name == effect.name]
        for sensor in others if found else ():
            _, outcomes[sensor] = search(sensor, (*base[sensor], *found))
    return outcomes


def _may_be(effect: type[Effect], outcome: Outcome) -> bool:
    """Tell whether an effect is named, or explains what is named as well."""
    return any(effect.name in (n.rated.name, *n.ambiguous_with) for n in outcome.named)


def coupled_support(effect: Effect, searched: Sequence[Found]) -> float:
    """Return the χ² that other sensors add to an effect of the first; −∞: they refute it.

    One set of coefficients, fitted to all sensors beside what else was named, explains less than
    the first alone would like where the others do not feel it: a scale factor that is equal on
    all axes is a tilt to the accelerometer in three orientations, but not to the magnetometer.
    """
    equations = []
    for bank, outcome in searched:
        known = [
            term
            for named in outcome.named
            if effect.name not in (named.rated.name, *named.ambiguous_with)
            for term in named.rated.form.terms
        ]
        equations.append(bank.shared_equations(known, bank.term(effect)))
    alone = _explained_by(*equations[0])
    normals, rights = zip(*equations, strict=True)
    support = _explained_by(np.sum(normals, axis=0), np.sum(rights, axis=0)) - alone
    return support if support > -max(REFUTED, REFUTED_SHARE * alone) else -np.inf


def _explained_by(normal: FloatArray, right: FloatArray) -> float:
    return float(right @ np.linalg.pinv(normal, rcond=1e-9, hermitian=True) @ right)


def named_beside(base: Listed, outcomes: Mapping[Sensor, Outcome]) -> Listed:
    """Return the effects of the sensors in `base` together with what was named."""
    return {
        s: joined_effects([*effects, *(n.rated.form.effect for n in outcomes[s].named)])
        for s, effects in base.items()
    }


def _quieter(noise: NoiseModel, before: NoiseModel) -> bool:
    """Tell whether a part of the noise, fast or slow, is gone that was there before."""
    parts = [(n.variance_of_means(PERIOD), n.amplitudes**2) for n in (noise, before)]
    (means, slow), (means_before, slow_before) = parts
    total = slow_before.sum(axis=0)
    return bool(
        (means < CHANGED * means_before).any() or (slow.sum(axis=0) < CHANGED * total).any()
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


def _explained(
    runs: Sequence[PreparedRun],
    base: Listed,
    outcomes: Mapping[Sensor, Outcome],
    noise: Mapping[Sensor, NoiseModel],
) -> Explained:
    listed = named_beside(base, outcomes)
    coupled = {e for effects in listed.values() for e in effects if e.coupled}
    for effect in coupled:
        for sensor in listed:
            if sensor in effect.sensors and effect not in listed[sensor]:
                listed[sensor] = (*listed[sensor], effect)
    if all(listed[s] == base[s] for s in listed):
        return Explained(None, None, ())
    model = fit_prepared(listed, runs, noise=noise)
    comparison = compare_prepared(model, runs)
    before = fit_prepared(base, runs, noise=noise, refine=False).provenance.notes
    new = tuple(note for note in model.provenance.notes if note not in before)
    return Explained(model, comparison, new)
