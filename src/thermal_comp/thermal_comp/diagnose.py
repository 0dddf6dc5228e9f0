# SPDX-License-Identifier: Apache-2.0
"""Say which physical effect a model misses, or that none does, or that none explains it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from imu_recording.recording import ImuRecording

from thermal_comp.compare import compare_prepared
from thermal_comp.conditions import CHANNELS, SENSORS, Sensor
from thermal_comp.diagnose_bank import ColumnBank, ColumnSource
from thermal_comp.diagnose_calibration import calibrated_thresholds
from thermal_comp.diagnose_candidates import families, missing_channels
from thermal_comp.diagnose_decision import Outcome
from thermal_comp.diagnose_findings import (
    Explained,
    effect_findings,
    noise_finding,
    quality_finding,
    sensor_state,
    unnamed_findings,
    with_verdict,
)
from thermal_comp.diagnose_judges import judges
from thermal_comp.diagnose_known import least_gains
from thermal_comp.diagnose_result import Diagnosis, Finding, SensorState
from thermal_comp.diagnose_search import Search
from thermal_comp.diagnose_thresholds import EVERYWHERE
from thermal_comp.diagnose_tilt import TILT, may_tilt, tilt_support, tilts
from thermal_comp.diagnose_undecidable import undecidable
from thermal_comp.diagnose_veto import decide_confirmed
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.joined import joined_effects
from thermal_comp.fit import fit_prepared, usable_sensors
from thermal_comp.intake import take_in
from thermal_comp.model import NoiseModel, ThermalModel
from thermal_comp.noise import fit_noise
from thermal_comp.preparation import PERIOD
from thermal_comp.prepared_run import PreparedRun

Listed = dict[Sensor, tuple[Effect, ...]]


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
    intake = take_in(recordings, period=period)
    runs, clock = intake.runs, intake.clock
    settings = Settings(catalogue or EFFECTS, None, reference, intake.bandwidth_known)
    if calibrate:
        base = {sensor: base_effects(model, sensor) for sensor in SENSORS}
        thresholds = calibrated_thresholds(runs, base, settings.catalogue, calibrate)
        settings = replace(settings, thresholds=thresholds)
    diagnosis = diagnose_prepared(runs, model, settings)
    findings = [quality_finding(defect) for defect in intake.defects]
    if clock is not None and clock.evidence > EVERYWHERE:
        slope = {'value': clock.slope, 'std': clock.slope_std, 'unit': '1/K'}
        findings.append(
            Finding(
                'effect',
                'clock_temperature',
                'all',
                clock.evidence,
                EVERYWHERE,
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
    noise = {sensor: fit_noise(runs, sensor) for sensor in sensors}
    base: Listed = {sensor: base_effects(model, sensor) for sensor in sensors}
    outcomes = search_sensors(runs, base, noise, settings)
    current = compare_prepared(
        fit_prepared(base, runs, noise=noise, refine=False), runs, noise=noise
    )
    findings: list[Finding] = []
    explained = _explained(runs, base, outcomes, noise)
    for sensor, outcome in outcomes.items():
        findings += effect_findings(sensor, outcome, current, explained, settings.thresholds)
        findings += unnamed_findings(sensor, outcome, current)
    states: dict[str, SensorState] = {s: sensor_state(s, outcomes[s], current) for s in sensors}
    for sensor in sensors:
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
        undecided=undecidable(runs, base, outcomes, noise),
        notes=(*current.notes, *notes),
    )


def base_effects(model: ThermalModel | None, sensor: Sensor) -> tuple[Effect, ...]:
    """Return the effects of the model that is diagnosed; the line per axis without one."""
    if model is None or sensor not in model.sensors:
        return (EFFECTS['bias_temperature'](),)
    return model.sensors[sensor].effects


def search_sensors(
    runs: Sequence[PreparedRun],
    base: Listed,
    noise: Mapping[Sensor, NoiseModel],
    settings: Settings,
) -> dict[Sensor, Outcome]:
    """Return what is said about each sensor.

    A fixture that tilts turns the field as well: where the accelerometer may have found a tilt,
    the magnetometer is asked, and a tilt that is found is taken as known for it.
    """
    source = ColumnSource(runs)
    missing = [c for c in CHANNELS if not any(run.conditions.has(c) for run in runs)]
    searches: dict[Sensor, Search] = {}
    outcomes: dict[Sensor, Outcome] = {}

    def search(sensor: Sensor, known: tuple[Effect, ...], **support: float) -> None:
        bank = ColumnBank(source, sensor, noise[sensor], known)
        offered = {
            name: effect
            for name, effect in settings.catalogue.items()
            if name not in {e.name for e in known if e.name != 'bias_step'}
            and not (name == TILT and sensor == 'magnetometer' and len(base) > 1)
        }
        least = least_gains(source, sensor, noise[sensor], known)
        found = Search(
            bank, families(bank, offered), settings.thresholds, support=support, least_gains=least
        )
        searches[sensor] = found
        outcomes[sensor] = decide_confirmed(found, judges(bank), missing, known)

    for sensor, effects in base.items():
        search(sensor, effects)
    first, second = outcomes.get('accelerometer'), outcomes.get('magnetometer')
    if first is not None and second is not None and may_tilt(first):
        banks = [searches[s].bank for s in ('accelerometer', 'magnetometer')]
        tilt = settings.catalogue[TILT]()
        support = tilt_support(tilt, banks, (first, second))
        search('accelerometer', base['accelerometer'], **{TILT: support})
        found = tilts(outcomes['accelerometer'])
        if found:
            search('magnetometer', (*base['magnetometer'], *found))
    return outcomes


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
    listed: Listed = {
        sensor: joined_effects([*base[sensor], *(n.rated.form.effect for n in outcome.named)])
        for sensor, outcome in outcomes.items()
    }
    coupled = {e for effects in listed.values() for e in effects if e.coupled}
    for effect in coupled:
        for sensor in listed:
            if sensor in effect.sensors and effect not in listed[sensor]:
                listed[sensor] = (*listed[sensor], effect)
    if all(listed[s] == base[s] for s in listed):
        return Explained(None, None, ())
    model = fit_prepared(listed, runs, noise=noise)
    comparison = compare_prepared(model, runs, noise=noise)
    before = fit_prepared(base, runs, noise=noise, refine=False).provenance.notes
    new = tuple(note for note in model.provenance.notes if note not in before)
    return Explained(model, comparison, new)
