# SPDX-License-Identifier: Apache-2.0
"""Outcomes as findings: with errors before and after, parameters and a sentence."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from imu_recording.recording import SENSOR_UNITS

from thermal_comp.comparison.compare import Comparison, SensorComparison, rms_of
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.quality import QualityFinding
from thermal_comp.diagnosis.detection_limit import smallest_found
from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.effect_sets import NOT_IN_CATALOGUE, UNLOGGED
from thermal_comp.diagnosis.evidence.posterior import CREDIBLE_PROBABILITY, probability
from thermal_comp.diagnosis.inputs import ClockFinding
from thermal_comp.diagnosis.noise_level import (
    DEFAULT_CHIP,
    REPORTED_EVIDENCE,
    NoiseReference,
    chip_references,
    is_shipped_chip,
    noise_above_reference,
)
from thermal_comp.diagnosis.result import Finding, RankedEffect, SensorState
from thermal_comp.diagnosis.sensor_answer import UNNAMED_CAUSES, SensorAnswer
from thermal_comp.effects.effect import Effect, joined_effects
from thermal_comp.model.values import NoiseModel, ThermalModel

CLOCK_EVIDENCE = 15.0
"""Evidence from which a temperature coefficient of the clock is reported."""
LARGEST_CLOCK_COEFFICIENT = 100e-6
"""Temperature coefficient up to which RC oscillators of MEMS sensors reach [1/K]."""
LEAST_ERROR_RATIO = 1.1
"""Held-out error over the noise floor from which a model leaves more than noise."""
MOST_PLACES_LISTED = 6
"""Places named per sensor."""


@dataclass(frozen=True, eq=False)
class Explained:
    """The model with everything that was named."""

    model: ThermalModel | None
    comparison: Comparison | None
    undetermined: tuple[str, ...]


def form_approximate(compared: Iterable[SensorComparison]) -> str:
    """Return what a sentence adds where an effect is the cause, its equation not the whole of it.

    `compared` are the sensors it acts on, under the model with it.
    """
    worst = max(float(np.nanmax(part.held_out_rms / part.noise_floor)) for part in compared)
    if worst > LEAST_ERROR_RATIO:
        return 'form approximate: its equation leaves more than noise'
    return 'form approximate: its equation is probably off, by less than the noise'


def effect_findings(
    sensor: Sensor, answer: SensorAnswer, current: Comparison, explained: Explained
) -> list[Finding]:
    """Return one finding per effect that is named."""
    after = explained.comparison
    form = ''
    if answer.likeliest.approximate:
        form = form_approximate([(after or current).sensors[sensor]])
    findings = []
    for name, effect in {effect.name: effect for effect in answer.named}.items():
        label = '+'.join(effect.sensors) if effect.coupled else sensor
        rivals = _rivals(answer, name)
        findings.append(
            Finding(
                kind='effect',
                name=name,
                sensor=label,
                evidence=answer.evidence(name),
                threshold=answer.needed_evidence,
                probability=answer.probability_of(name),
                ambiguous_with=tuple(rival for rival, _ in rivals[:2]),
                error_before=rms_of(current.sensors[sensor].held_out_rms),
                error_after=rms_of(after.sensors[sensor].held_out_rms) if after else None,
                noise_floor=rms_of(after.sensors[sensor].noise_floor) if after else None,
                unit=SENSOR_UNITS[sensor],
                rivals=tuple({'name': n, 'probability': p} for n, p in rivals),
                parameters=_parameters(effect, sensor, explained),
                text=effect_sentence(
                    name, label, answer.probability_of(name), [r for r, _ in rivals[:2]], form
                ),
            )
        )
    return sorted(findings, key=lambda f: -f.evidence)


def _rivals(answer: SensorAnswer, name: str) -> list[tuple[str, float]]:
    """Return what could stand in an effect's place, with probabilities that are not negligible.

    An effect that cannot be told from another whose channel is missing has that one as rival.
    """
    kept = {c.name for c in answer.likeliest.components}
    rivals: dict[str, float] = {}
    for other in answer.explanations:
        if name in other.names or other.names == ():
            continue
        for rival in set(other.names) - kept - {NOT_IN_CATALOGUE, UNLOGGED}:
            rivals[rival] = rivals.get(rival, 0.0) + other.probability
    own = answer.probability_of(name)
    alike = {name, *(n for n, p in rivals.items() if p > 1.0 - CREDIBLE_PROBABILITY)}
    for effect in answer.offered:
        if effect.name in alike and effect.twin in answer.untried:
            rivals[effect.twin] = priors.UNSEEN_TWIN_ODDS * own
    ranked = sorted(rivals.items(), key=lambda pair: -pair[1])
    return [(rival, p) for rival, p in ranked if p > 1.0 - CREDIBLE_PROBABILITY]


def effect_sentence(
    name: str, label: str, chance: float, rivals: Sequence[str] = (), form: str = ''
) -> str:
    """Return that a sensor lacks an effect, as surely as it is probable: `chance` 0 … 1.

    `rivals` explain it as well; `form` is what the effect's equation lacks.

    >>> effect_sentence('thermal_lag', 'gyroscope', 0.7, ('warm_up',))
    'gyroscope: thermal_lag is probably missing; warm_up explains it as well'
    """
    verb = 'is' if chance >= CREDIBLE_PROBABILITY else 'is probably' if chance > 0.5 else 'may be'
    text = f'{label}: {name} {verb} missing'
    if rivals:
        verb = 'explain' if len(rivals) > 1 else 'explains'
        text += f'; {" and ".join(rivals)} {verb} it as well'
    return f'{text}; {form}' if form else text


def _parameters(
    effect: Effect, sensor: Sensor, explained: Explained
) -> dict[str, dict[str, object]]:
    """Return the shape parameters as fitted jointly, with standard deviations."""
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
    known = other.shape_parameters
    pairs = [(value, known[n]) for n, value in one.shape_parameters.items() if n in known]
    return sum(abs(float(np.sum(a)) - float(np.sum(b))) for a, b in pairs)


def unnamed_findings(sensor: Sensor, answer: SensorAnswer, current: Comparison) -> list[Finding]:
    """Return the finding of a sensor whose residual has no name."""
    kind = answer.kind
    if kind not in UNNAMED_CAUSES:
        return []
    before, likeliest = current.sensors[sensor], answer.likeliest
    if kind == 'unlogged':
        text = f'{sensor}: a variable acts that was not logged: {likeliest.depends_on}'
    else:
        text = f'{sensor}: no effect of the catalogue; depends on {likeliest.depends_on}'
    own = answer.named
    if own:
        text += f', beside {" and ".join(dict.fromkeys(effect.name for effect in own))}'
    tried = dict.fromkeys(c.name for c in likeliest.components)
    if tried.keys() - {effect.name for effect in own}:
        text += f' (closest together: {", ".join(tried)})'
    return [
        Finding(
            kind=kind,
            name=None,
            sensor=sensor,
            evidence=answer.evidence(),
            threshold=answer.needed_evidence,
            probability=answer.probability_of(UNNAMED_CAUSES[kind]),
            depends_on=likeliest.depends_on,
            error_before=rms_of(before.held_out_rms),
            noise_floor=rms_of(before.noise_floor),
            unit=SENSOR_UNITS[sensor],
            text=text,
        )
    ]


def noise_findings(
    noise: Mapping[Sensor, NoiseModel],
    current: Comparison,
    reference: NoiseReference | None,
    *,
    duration: float,
    bandwidth_known: bool = False,
) -> dict[Sensor, Finding]:
    """Return what is too high in the noise, by sensor; nothing of a chip without reference.

    `reference` None: the shipped chip's, where this is that chip. `duration` [s] is that of all
    runs together.
    """
    findings: dict[Sensor, Finding] = {}
    if reference is None:
        if not is_shipped_chip(noise):
            return findings
        reference = chip_references()[DEFAULT_CHIP]
    for sensor, model in noise.items():
        if sensor not in reference.sensors:
            continue
        above = noise_above_reference(
            model,
            reference.sensors[sensor],
            duration=duration,
            bandwidth_known=bandwidth_known,
        )
        if above is None:
            continue
        state = current.sensors[sensor]
        ratios = {'white': above.white_ratio if bandwidth_known else None,
                  'bias instability': above.flicker_ratio}  # fmt: skip
        said = ', '.join(f'{name} × {r:.2f}' for name, r in ratios.items() if r is not None)
        findings[sensor] = Finding(
            kind='noise',
            name=above.name,
            sensor=sensor,
            evidence=above.evidence,
            threshold=REPORTED_EVIDENCE,
            error_before=rms_of(state.held_out_rms),
            noise_floor=rms_of(state.noise_floor),
            unit=SENSOR_UNITS[sensor],
            text=f'{sensor}: noise above that of {reference.name}, {said}',
        )
    return findings


def clock_findings(clock: ClockFinding | None) -> list[Finding]:
    """Return the temperature coefficient of the sampling clock as a finding, if it counts."""
    if clock is None or clock.evidence <= CLOCK_EVIDENCE:
        return []
    ordinary = abs(clock.slope) <= LARGEST_CLOCK_COEFFICIENT
    usual = ', as RC oscillators do; stamps hold it, no sensor fails for it' if ordinary else ''
    return [
        Finding(
            kind='clock' if ordinary else 'effect',
            name='clock_temperature',
            sensor='all',
            evidence=clock.evidence,
            threshold=CLOCK_EVIDENCE,
            error_before=clock.rms_before,
            error_after=clock.rms_after,
            unit='1',
            parameters={'slope': {'value': clock.slope, 'std': clock.slope_std, 'unit': '1/K'}},
            text=f'the sampling interval changes by {clock.slope * 1e6:.1f} ppm/K{usual}',
        )
    ]


def ranked(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return what changed first, then defects and what sensors lack, then clock and noise."""
    return tuple(sorted(findings, key=_sort_key))


def _sort_key(finding: Finding) -> tuple[int, float]:
    """Return what findings are ordered by: their kind, then their evidence."""
    if finding.name == 'clock_temperature':
        return 2, -finding.evidence
    return {'changed': 0, 'noise': 3}.get(finding.kind, 1), -finding.evidence


def ranked_effects(answers: Mapping[Sensor, SensorAnswer]) -> tuple[RankedEffect, ...]:
    """Return every effect that was weighed, sensor by sensor, most probable first.

    Its probability is that it acts visibly; what it may add unseen beside others does not count.
    """
    found: list[RankedEffect] = []
    for sensor, answer in answers.items():
        together = {e.name: e for e in joined_effects((*answer.named, *answer.closest))}
        alone = {s.names[0]: s for s in answer.sets if len(s.names) == 1 and not s.guessed}
        own = [
            RankedEffect(
                sensor,
                together.get(name, one.components[0].form.effect),
                probability(
                    answer.explanations,
                    lambda e, n=name: n in e.names and e.unseen != n,  # type: ignore[misc]
                ),
                one.log_posterior - answer.hypotheses.log_prior(0),
            )
            for name, one in alone.items()
        ]
        found += sorted(own, key=lambda r: (-round(r.probability, 12), -r.log_odds))
    return tuple(found)


def sensor_states(
    answers: Mapping[Sensor, SensorAnswer],
    current: Comparison,
    loud: Collection[Sensor],
    changed: Sequence[Finding],
) -> dict[str, SensorState]:
    """Return how each sensor stands; `loud` ones are above the reference, `changed` is found."""
    others = {finding.sensor for finding in changed}
    return {
        sensor: sensor_state(
            sensor, answer, current, loud=sensor in loud, changed=sensor in others
        )
        for sensor, answer in answers.items()
    }


def sensor_state(
    sensor: Sensor,
    answer: SensorAnswer,
    current: Comparison,
    *,
    loud: bool = False,
    changed: bool = False,
) -> SensorState:
    """Return how the sensor stands under the model.

    `loud`: its noise is above the reference; `changed`: stored coefficients are no longer right.
    """
    compared = current.sensors[sensor]
    verdict: str = answer.kind
    if verdict == 'named':
        first = answer.likeliest.components[0].name
        verdict = 'ambiguous' if _rivals(answer, first) else 'missing'
    elif changed and verdict == 'complete':
        verdict = 'changed'
    elif loud and verdict == 'complete':
        verdict = 'noise_above_reference'
    where = [w for w in compared.where if set(w.group) == {'phase', 'cycle'}][:MOST_PLACES_LISTED]
    return SensorState(
        verdict=verdict,
        residual_rms=tuple(map(float, compared.residual_rms)),
        held_out_rms=tuple(map(float, compared.held_out_rms)),
        noise_floor=tuple(map(float, compared.noise_floor)),
        unit=SENSOR_UNITS[sensor],
        where=tuple(
            {**w.group, 'ratio': float(w.ratio)}
            for w in where or compared.where[:MOST_PLACES_LISTED]
        ),
        smallest_found=smallest_found(answer.hypotheses, answer.needed_evidence)
        if answer.kind == 'complete'
        else {},
    )


def quality_finding(defect: QualityFinding) -> Finding:
    """Return a defect of the data as a finding."""
    return Finding(
        kind='data_quality',
        name=defect.name,
        sensor=defect.sensor,
        evidence=defect.evidence,
        threshold=0.0,
        text=defect.text,
    )
