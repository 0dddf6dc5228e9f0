# SPDX-License-Identifier: Apache-2.0
"""The thermal cycle that best separates two effects (T-optimality, Atkinson and Fedorov)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from imu_recording.user_error import did_you_mean

from thermal_comp.data.conditions import Sensor
from thermal_comp.effects.effect import FLIP_ACTION, Effect
from thermal_comp.experiment.plan import PAPER_PLAN, REFERENCE_C, Plan, Segment, predict_runs
from thermal_comp.experiment.predicted_design import PredictedDesign, Rival
from thermal_comp.model.values import ModelError, NoiseModel, ThermalModel

LEAST_REPEATS, MOST_REPEATS = 3, 8
"""Cycles of a run: one is held out at a time, which two would hardly bear."""
SHORTEST_DWELL_S = 120.0
"""Shortest dwell that a plan is cut to [s]."""
SEARCH_STARTS = 4
"""Plans that the search starts from."""
LEAST_EVIDENCE_RATIO = 1.02
"""Ratio of evidence from which another plan is preferred to the paper's."""
SEPARATING_EVIDENCE = 20.0
"""Evidence from which two effects count as told apart."""
UPRIGHT_AXES = ('+x', '+y', '+z')
FLIPPED_AXES = (*UPRIGHT_AXES, '-z')
FLIP_Z = 'flip: add a run with the z axis down'
FAST_RATE_C_PER_MIN = 5.0
"""Ramps of a fast chamber [°C/min]: evidence for effects of the rate grows with its square."""
MOST_CAMPAIGNS = 6
"""Repetitions that are still advised."""


@dataclass(frozen=True)
class ChamberLimits:
    """Temperatures [°C], ramps and time that a plan may take."""

    low: float = -10.0
    high: float = 50.0
    max_rate: float = 2.0
    """[°C/min]."""
    hours: float = 12.0
    """Length of a run [h]."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """The plan that separates best, with the evidence it promises."""

    plan: Plan
    sensor: Sensor
    evidence_before: float
    """Promised by the paper's plan."""
    evidence_after: float
    separable: bool
    actions: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Separation:
    """The evidence that plans promise between two effects of the size they are expected to have.

    Each effect leaves a residual that the other and the rest of the model do not explain; the
    lesser one counts.
    """

    rivals: tuple[Rival, Rival]
    sensor: Sensor
    noise: NoiseModel
    base: tuple[Effect, ...]

    def evidence(self, plan: Plan, up_axes: Sequence[str] = UPRIGHT_AXES) -> float:
        """Return the whitened sum of squares that runs of the plan would show."""
        design = PredictedDesign(predict_runs(plan, up_axes), self.sensor, self.noise, self.base)
        one, other = self.rivals
        return min(
            design.evidence(truth, rival)
            for truth, rival in ((one, other), (other, one))
            if not _is_part_of(truth.effect, rival.effect)
        )


def design_experiment(
    names: tuple[str, str],
    model: ThermalModel,
    limits: ChamberLimits,
    catalogue: dict[str, type[Effect]],
    *,
    seed: int = 0,
    evaluations: int = 160,
    missing: Mapping[Sensor, float] | None = None,
) -> Proposal:
    """Return the plan within the limits that best tells two effects apart.

    `missing` is the rms that either has to explain [unit], by sensor, the largest first; None:
    effects of a usual size.
    """
    separation = separation_of(names, model, catalogue, missing)
    before = separation.evidence(within(PAPER_PLAN, limits))
    rng = np.random.default_rng(seed)
    plan, after = best_plan(separation.evidence, limits, rng, evaluations)
    separable = after >= SEPARATING_EVIDENCE
    actions = [] if separable else _actions(separation, plan, after, limits)
    return Proposal(
        plan=plan,
        sensor=separation.sensor,
        evidence_before=before,
        evidence_after=after,
        separable=separable,
        actions=tuple(actions),
    )


def separation_of(
    names: tuple[str, str],
    model: ThermalModel,
    catalogue: dict[str, type[Effect]],
    missing: Mapping[Sensor, float] | None = None,
) -> Separation:
    """Return the measure of plans: the effects as the model has them, and its noise.

    `missing`: as of `design_experiment`.
    """
    unknown = [name for name in names if name not in catalogue]
    if unknown:
        near = did_you_mean(unknown[0], catalogue)
        raise ModelError(
            f'effect {unknown[0]!r} is not known{near}; known: {", ".join(catalogue)}'
        )
    if names[0] == names[1]:
        raise ModelError(f'{names[0]} and {names[1]} are the same effect')
    missing = missing or {}
    sensor = _sensor(names, model, catalogue, missing)
    noise = model.sensors[sensor].noise
    if noise is None:
        raise ModelError(f'sensors.{sensor}.noise: the model has none; fit it again')
    base = tuple(e for e in model.sensors[sensor].effects if e.name not in names)
    usual = PredictedDesign(predict_runs(PAPER_PLAN, UPRIGHT_AXES), sensor, noise, base)
    rms = missing.get(sensor)
    one, other = (Rival.of(name, model, sensor, catalogue).sized(usual, rms) for name in names)
    return Separation((one, other), sensor, noise, base)


def _actions(
    separation: Separation, plan: Plan, reached: float, limits: ChamberLimits
) -> list[str]:
    """Return what helps where the best plan does not separate the effects."""
    told = (rival.effect.separating_action for rival in separation.rivals)
    actions = [action for action in told if action]
    # A fourth run is more data in any orientation: turning it has to bring more than that.
    upright = separation.evidence(plan, (*UPRIGHT_AXES, '+z'))
    if separation.evidence(plan, FLIPPED_AXES) >= max(SEPARATING_EVIDENCE, 2.0 * upright):
        actions = [FLIP_Z, *(action for action in actions if action != FLIP_ACTION)]
    if (
        limits.max_rate < FAST_RATE_C_PER_MIN
        and separation.evidence(_faster(plan, limits)) >= SEPARATING_EVIDENCE
    ):
        actions.append(f'ramp at {FAST_RATE_C_PER_MIN:g} °C/min, if the chamber can')
    if reached >= SEPARATING_EVIDENCE / MOST_CAMPAIGNS:
        actions.append(
            f'repeat it: {ceil(SEPARATING_EVIDENCE / reached)} campaigns like this one add up'
        )
    return list(dict.fromkeys(actions))


def _is_part_of(effect: Effect, richer: Effect) -> bool:
    """Tell whether a rival contains the effect: then only its other parts can be told apart."""
    return any(type(part) is type(effect) for part in richer.parts() if part is not richer)


def _faster(plan: Plan, limits: ChamberLimits) -> Plan:
    """Return the plan with every ramp that is at the limit as fast as FAST_RATE_C_PER_MIN."""
    cycle = tuple(
        replace(s, rate=FAST_RATE_C_PER_MIN if s.rate >= limits.max_rate else s.rate)
        for s in plan.cycle
    )
    return within(Plan(cycle, plan.repeats), replace(limits, max_rate=FAST_RATE_C_PER_MIN))


def _sensor(
    names: tuple[str, str],
    model: ThermalModel,
    catalogue: dict[str, type[Effect]],
    missing: Mapping[Sensor, float],
) -> Sensor:
    """Return the sensor whose model holds one of the effects, else one that lacks something."""
    both = [s for s in catalogue[names[0]].sensors if s in catalogue[names[1]].sensors]
    both = [s for s in both if s in model.sensors]
    if not both:
        raise ModelError(f'{names[0]} and {names[1]} act on no common sensor of the model')
    holding = [s for s in both if {e.name for e in model.sensors[s].effects} & set(names)]
    lacking = [s for s in missing if s in both]
    return (holding or lacking or both)[0]


def within(plan: Plan, limits: ChamberLimits) -> Plan:
    """Return the plan cut to the limits, with as many repeats as the time allows."""
    cycle = _moving(
        Segment(
            float(np.clip(s.target, limits.low, limits.high)),
            min(s.rate, limits.max_rate),
            s.dwell,
        )
        for s in plan.cycle
    )
    for repeats in range(MOST_REPEATS, LEAST_REPEATS - 1, -1):
        if Plan(cycle, repeats).hours <= limits.hours:
            return Plan(cycle, repeats)
    shorter = tuple(replace(s, dwell=s.dwell * 0.7) for s in cycle)
    if min((s.dwell for s in shorter), default=0.0) < SHORTEST_DWELL_S:
        raise ModelError(
            f'{limits.hours:g} h are too short for {LEAST_REPEATS} cycles between '
            f'{limits.low:g} and {limits.high:g} °C at {limits.max_rate:g} °C/min'
        )
    return within(Plan(shorter, LEAST_REPEATS), limits)


def _moving(segments: Iterable[Segment]) -> tuple[Segment, ...]:
    """Return the segments, those without a change of temperature joined to the dwell before.

    A chamber refuses a ramp to where it already is; a cycle begins at the reference temperature.
    """
    joined: list[Segment] = []
    for segment in segments:
        if segment.target != (joined[-1].target if joined else REFERENCE_C):
            joined.append(segment)
        elif joined:
            joined[-1] = replace(joined[-1], dwell=joined[-1].dwell + segment.dwell)
    return tuple(joined)


def best_plan(
    promise: Callable[[Plan], float],
    limits: ChamberLimits,
    rng: np.random.Generator,
    evaluations: int,
) -> tuple[Plan, float]:
    """Return the best plan and its evidence; a step changes, inserts or drops one segment."""
    best = within(PAPER_PLAN, limits)
    best_value = promise(best)
    for start in range(SEARCH_STARTS):
        plan = best if start == 0 else within(Plan(_random_cycle(limits, rng), 4), limits)
        value = promise(plan)
        for _ in range(evaluations // SEARCH_STARTS):
            trial = _changed(plan, limits, rng)
            if trial is None:
                continue
            reached = promise(trial)
            if reached > value:
                plan, value = trial, reached
        if value > LEAST_EVIDENCE_RATIO * best_value + 1e-3:
            best, best_value = plan, value
    return best, best_value


def _random_segment(limits: ChamberLimits, rng: np.random.Generator) -> Segment:
    return Segment(
        float(np.round(rng.uniform(limits.low, limits.high))),
        float(rng.choice([0.5, 1.0, limits.max_rate, limits.max_rate])),
        float(rng.choice([300.0, 600.0, 1200.0, 1800.0, 3600.0])),
    )


def _random_cycle(limits: ChamberLimits, rng: np.random.Generator) -> tuple[Segment, ...]:
    inner = tuple(_random_segment(limits, rng) for _ in range(int(rng.integers(2, 5))))
    return _closed(inner, limits)


def _closed(inner: tuple[Segment, ...], limits: ChamberLimits) -> tuple[Segment, ...]:
    """Return the cycle ending at the reference temperature."""
    home = float(np.clip(REFERENCE_C, limits.low, limits.high))
    return (*inner, Segment(home, limits.max_rate, 900.0))


def _changed(plan: Plan, limits: ChamberLimits, rng: np.random.Generator) -> Plan | None:
    """Return the plan with one segment changed, inserted or dropped; None beyond the limits."""
    inner = list(plan.cycle[:-1])
    act = rng.choice(['change', 'change', 'insert', 'drop'])
    place = int(rng.integers(max(len(inner), 1)))
    if not inner:
        inner.append(_random_segment(limits, rng))
    elif act == 'drop' and len(inner) > 2:
        inner.pop(place)
    elif act == 'insert' and len(inner) < 7:
        inner.insert(place, _random_segment(limits, rng))
    else:
        inner[place] = _random_segment(limits, rng)
    try:
        return within(Plan(_closed(tuple(inner), limits), 4), limits)
    except ModelError:
        return None
