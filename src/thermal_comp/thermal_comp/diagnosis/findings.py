# SPDX-License-Identifier: Apache-2.0
"""Outcomes as findings: with errors before and after, parameters and a sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from imu_recording.recording import SENSOR_UNITS

from thermal_comp.comparison.compare import Comparison
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.quality import QualityFinding
from thermal_comp.diagnosis.decision import IdentifiedEffect, Outcome
from thermal_comp.diagnosis.inputs import ClockFinding
from thermal_comp.diagnosis.noise_level import REPORTED_EVIDENCE, noise_above_reference
from thermal_comp.diagnosis.result import Finding, SensorState
from thermal_comp.diagnosis.thresholds import threshold_of
from thermal_comp.effects.effect import LEAST_EVIDENCE, Effect
from thermal_comp.model.values import NoiseModel, ThermalModel

LISTED_WHERE = 6
"""Places named per sensor."""


@dataclass(frozen=True, eq=False)
class Explained:
    """The model with everything that was named."""

    model: ThermalModel | None
    comparison: Comparison | None
    undetermined: tuple[str, ...]


def effect_findings(
    sensor: Sensor,
    outcome: Outcome,
    current: Comparison,
    explained: Explained,
    thresholds: Mapping[str, float] | None,
) -> list[Finding]:
    """Return one finding per effect that is named."""
    findings = []
    seen: set[str] = set()
    for named in outcome.named:
        if named.scored.name in seen:
            continue
        seen.add(named.scored.name)
        effect = named.scored.form.effect
        label = '+'.join(effect.sensors) if effect.coupled else sensor
        after = explained.comparison
        findings.append(
            Finding(
                'effect',
                named.scored.name,
                label,
                named.scored.evidence,
                LEAST_EVIDENCE if named.shared else threshold_of(effect, thresholds),
                ambiguous_with=named.ambiguous_with,
                error_before=_rms(current.sensors[sensor].held_out_rms),
                error_after=_rms(after.sensors[sensor].held_out_rms) if after else None,
                noise_floor=_rms(after.sensors[sensor].noise_floor) if after else None,
                unit=SENSOR_UNITS[sensor],
                rivals=tuple({'name': name, 'similarity': s} for name, s in named.rivals),
                parameters=_parameters(named, sensor, explained),
                text=_sentence(named, label),
            )
        )
    return findings


def _sentence(named: IdentifiedEffect, label: str) -> str:
    text = f'{label}: {named.scored.name} is missing'
    if named.ambiguous_with:
        verb = 'explain' if len(named.ambiguous_with) > 1 else 'explains'
        text += f'; {" and ".join(named.ambiguous_with)} {verb} it as well'
    if named.approximate:
        text += '; form approximate: its equation leaves more than noise'
    return text


def _parameters(
    named: IdentifiedEffect, sensor: Sensor, explained: Explained
) -> dict[str, dict[str, object]]:
    """Return the shape parameters as fitted jointly, with standard deviations."""
    effect = named.scored.form.effect
    model = explained.model.sensors[sensor] if explained.model else None
    fitted = [e for e in (model.effects if model else ()) if e.name == effect.name]
    found = min(fitted, key=lambda e: _distance(e, effect), default=effect)
    units = {item.name: item.metadata['unit'] for item in fields(effect)}
    table: dict[str, dict[str, object]] = {}
    for name, value in found.shape_parameters.items():
        spread = model.shape_std.get(f'{effect.name}.{name}') if model else None
        several = isinstance(value, tuple)
        std = None if spread is None else (list(spread) if several else spread[0])
        shown = list(value) if several else value
        table[name] = {'value': shown, 'std': std, 'unit': units[name]}
    return table


def _distance(one: Effect, other: Effect) -> float:
    pairs = zip(one.shape_parameters.values(), other.shape_parameters.values(), strict=True)
    return sum(abs(float(np.sum(a)) - float(np.sum(b))) for a, b in pairs)


def unnamed_findings(sensor: Sensor, outcome: Outcome, current: Comparison) -> list[Finding]:
    """Return the finding of a sensor whose residual has no name."""
    if outcome.kind not in {'unexplained', 'unlogged'}:
        return []
    before = current.sensors[sensor]
    if outcome.kind == 'unlogged':
        text = f'{sensor}: several effects at once, or {outcome.depends_on} was not logged'
    else:
        text = f'{sensor}: no effect of the catalogue; depends on {outcome.depends_on}'
    if outcome.tried:
        text += f' (closest together: {", ".join(outcome.tried)})'
    return [
        Finding(
            outcome.kind,
            None,
            sensor,
            outcome.evidence,
            LEAST_EVIDENCE,
            depends_on=outcome.depends_on,
            error_before=_rms(before.held_out_rms),
            noise_floor=_rms(before.noise_floor),
            unit=SENSOR_UNITS[sensor],
            text=text,
        )
    ]


def noise_findings(
    noise: Mapping[Sensor, NoiseModel],
    current: Comparison,
    reference: Mapping[str, NoiseModel] | None,
    *,
    bandwidth_known: bool = False,
) -> dict[Sensor, Finding]:
    """Return what is too high in the noise, by sensor."""
    findings = {}
    for sensor, model in noise.items():
        above = noise_above_reference(
            model, sensor, (reference or {}).get(sensor), bandwidth_known=bandwidth_known
        )
        if above is None:
            continue
        state = current.sensors[sensor]
        white = f'white × {above.white_ratio:.2f}, ' if bandwidth_known else ''
        findings[sensor] = Finding(
            'noise',
            above.name,
            sensor,
            above.evidence,
            REPORTED_EVIDENCE,
            error_before=_rms(state.held_out_rms),
            noise_floor=_rms(state.noise_floor),
            unit=SENSOR_UNITS[sensor],
            text=f'{sensor}: noise above the reference, {white}bias instability × '
            f'{above.flicker_ratio:.2f}',
        )
    return findings


def clock_findings(clock: ClockFinding | None) -> list[Finding]:
    """Return the temperature coefficient of the sampling clock as a finding, if it counts."""
    if clock is None or clock.evidence <= LEAST_EVIDENCE:
        return []
    return [
        Finding(
            'effect',
            'clock_temperature',
            'all',
            clock.evidence,
            LEAST_EVIDENCE,
            error_before=clock.rms_before,
            error_after=clock.rms_after,
            unit='1',
            parameters={'slope': {'value': clock.slope, 'std': clock.slope_std, 'unit': '1/K'}},
            text=f'the sampling interval changes by {clock.slope * 1e6:.1f} ppm/K',
        )
    ]


def ranked(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return the findings strongest first, those about the noise last."""
    return tuple(sorted(findings, key=lambda f: (f.kind == 'noise', -f.evidence)))


def sensor_state(
    sensor: Sensor, outcome: Outcome, current: Comparison, *, loud: bool = False
) -> SensorState:
    """Return how the sensor stands under the model; `loud`: its noise is above the reference."""
    compared = current.sensors[sensor]
    if outcome.kind == 'named':
        verdict = 'ambiguous' if outcome.named[0].ambiguous_with else 'missing'
    else:
        verdict = 'noise_above_reference' if loud and outcome.kind == 'complete' else outcome.kind
    where = [w for w in compared.where if set(w.group) == {'phase', 'cycle'}][:LISTED_WHERE]
    return SensorState(
        verdict,
        tuple(map(float, compared.residual_rms)),
        tuple(map(float, compared.held_out_rms)),
        tuple(map(float, compared.noise_floor)),
        SENSOR_UNITS[sensor],
        tuple(
            {**w.group, 'ratio': float(w.ratio)} for w in where or compared.where[:LISTED_WHERE]
        ),
    )


def quality_finding(defect: QualityFinding) -> Finding:
    """Return a defect of the data as a finding."""
    return Finding(
        'data_quality', defect.name, defect.sensor, defect.evidence, 0.0, text=defect.text
    )


def _rms(per_axis: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(per_axis))))
