# SPDX-License-Identifier: Apache-2.0
"""Effects that may be missing in one sensor: how probable, and what each would leave held out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import exp, log
from typing import Any

from thermal_comp.comparison.compare import rms_of
from thermal_comp.comparison.held_out import hold_out
from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.data.improvement import LEAST_FALL
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.result import Diagnosis, RankedEffect
from thermal_comp.effects.effect import Effect, joined_effects
from thermal_comp.model.values import ThermalModel
from thermal_comp.noise.of_runs import noise_of_runs
from thermal_comp.presentation.display import DISPLAY_UNITS, shown

from imu_workbench.answer import plain

LEAST_SHOWN_PROBABILITY = 0.005
"""Probability below which "< 1 %" is shown."""
HELD_OUT_CANDIDATES = 5
"""Candidates of a sensor whose held-out error is computed without being asked for."""


@dataclass(frozen=True)
class EffectCandidate:
    """One effect that may be missing; errors are rms over the axes [SI unit]."""

    effect: str
    sensor: str
    probability: float | None
    """None: it was not weighed."""
    log_odds: float | None
    """ln of the odds of it alone to nothing."""
    error_after: float | None
    """Held out; None: not computed yet."""
    shape: Mapping[str, Any] = field(default_factory=dict)
    """Shape parameters of the form that was weighed."""
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """The same as fitted beside everything that is named: value, std, unit."""
    named: bool = False
    """Whether the diagnosis says that it is missing."""
    empirical: bool = False
    """Whether it only lowers the error, its cause undecided."""

    def lowers(self, before: float) -> bool | None:
        """Tell whether the held-out error falls at all; None where it is not known."""
        return None if self.error_after is None else self.error_after < (1.0 - LEAST_FALL) * before


def candidates_of(found: Diagnosis) -> dict[str, list[EffectCandidate]]:
    """Return the candidates of every sensor, most probable first.

    Held-out errors are known of those that are named; `held_out` computes others.
    """
    content = found.to_dict()
    result: dict[str, list[EffectCandidate]] = {}
    for one in found.ranking:
        own = result.setdefault(one.sensor, [])
        finding = _finding(content, one)
        predicted = content['prediction'].get(one.sensor, {'empirical': False, 'terms': []})
        own.append(
            EffectCandidate(
                effect=one.name,
                sensor=one.sensor,
                probability=one.probability,
                log_odds=one.log_odds,
                error_after=finding['error_after'] if finding else None,
                shape=plain(dict(one.effect.shape_parameters)),
                parameters=finding['parameters'] if finding else {},
                named=finding is not None,
                empirical=bool(predicted['empirical']) and one.name in predicted['terms'],
            )
        )
    return result


def asks_for_errors(
    candidates: Mapping[str, Sequence[Mapping[str, Any]]], sensors: Iterable[str]
) -> bool:
    """Tell whether held-out errors of the most probable candidates are still to be computed."""
    first = (row for sensor in sensors for row in candidates.get(sensor, ())[:HELD_OUT_CANDIDATES])
    return any(row['error_after'] is None for row in first)


def with_errors(
    candidates: Mapping[str, Sequence[Mapping[str, Any]]],
    model: ThermalModel,
    runs: Sequence[PreparedRun],
    catalogue: Mapping[str, type[Effect]],
    progress: Callable[[str, float], None],
) -> dict[str, list[dict[str, Any]]]:
    """Return the fields of the candidates, the most probable with their held-out error."""
    rows = {s: [dict(row) for row in candidates[s]] for s in SENSORS if candidates.get(s)}
    missing = [
        (sensor, row)
        for sensor in rows
        for row in rows[sensor][:HELD_OUT_CANDIDATES]
        if row['error_after'] is None and sensor in model.sensors
    ]
    for number, (sensor, row) in enumerate(missing):
        name = row['effect'].replace('_', ' ')
        progress(f'what {name} would leave in the {sensor}', number / len(missing))
        effect = effect_of(row['effect'], row['shape'], catalogue)
        row['error_after'] = error_with(model, runs, sensor, effect)
    return {str(sensor): own for sensor, own in rows.items()}


def _finding(content: Mapping[str, Any], one: RankedEffect) -> Mapping[str, Any] | None:
    return next(
        (
            f
            for f in content['findings']
            if f['kind'] == 'effect'
            and f['name'] == one.name
            and one.sensor in f['sensor'].split('+')
        ),
        None,
    )


def error_with(
    model: ThermalModel, runs: Sequence[PreparedRun], sensor: Sensor, effect: Effect
) -> float:
    """Return the held-out error of a sensor with an effect beside those of the model."""
    part = model.sensors[sensor]
    noise = part.noise or noise_of_runs(runs, sensor)[0]
    listed = joined_effects([*part.effects, effect])
    return rms_of(hold_out(runs, {sensor: listed}, {sensor: noise}).rms(sensor))


def effect_of(
    candidate: str, shape: Mapping[str, Any], catalogue: Mapping[str, type[Effect]]
) -> Effect:
    """Return an effect in the form that was weighed."""
    given = {k: tuple(v) if isinstance(v, list) else v for k, v in shape.items()}
    return catalogue[candidate](**given)


def why_not(candidate: EffectCandidate, winner: EffectCandidate | None, before: float) -> str:
    """Return in a sentence why a candidate is not the one that is named; '' for that one."""
    if winner is None or candidate.effect == winner.effect or candidate.named:
        return ''
    unit = DISPLAY_UNITS[candidate.sensor]
    name = winner.effect.replace('_', ' ')
    odds = odds_text(winner, candidate)
    after, best = candidate.error_after, winner.error_after
    if after is None or best is None:
        return f'{odds} than {name}.' if odds else ''
    if after > (1.0 + LEAST_FALL) * best:
        return (
            f'Leaves {shown(after * unit.factor)} {unit.unit} held out, {name} '
            f'{shown(best * unit.factor)} {unit.unit}{f"; {odds}" if odds else ""}.'
        )
    if candidate.lowers(before):
        return (
            f'Lowers the held-out error as much as {name}'
            f'{f", but is {odds[0].lower()}{odds[1:]}: its form fits less well" if odds else ""}.'
        )
    return ''


def odds_text(winner: EffectCandidate, loser: EffectCandidate) -> str:
    """Return how much less probable one effect is than another, in words.

    By the probabilities that are shown; where the loser's is as good as zero, by the odds of each
    alone.
    """
    if winner.probability and loser.probability and loser.probability >= LEAST_SHOWN_PROBABILITY:
        apart = log(winner.probability / loser.probability)
    elif winner.log_odds is None or loser.log_odds is None:
        return ''
    else:
        apart = winner.log_odds - loser.log_odds
    if apart < 0.7:
        return ''
    if apart > 14.0:
        return 'more than a million times less probable'
    digits = f'{float(f"{exp(apart):.1g}"):,.0f}'.replace(',', '\N{NARROW NO-BREAK SPACE}')
    return f'{digits} times less probable'
