# SPDX-License-Identifier: Apache-2.0
"""Exchange search for the thermal cycle within a chamber's limits that promises most."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from thermal_comp.experiment_plan import PAPER, REFERENCE_C, Plan, Segment
from thermal_comp.model import ModelError

LEAST_REPEATS = 3
"""Cycles that stay, so that one can be left out."""
MOST_REPEATS = 8
SHORTEST_DWELL_S = 120.0
STARTS = 4
WORTH_IT = 1.02
"""Ratio of evidence below which the plan one knows is kept."""


@dataclass(frozen=True)
class Limits:
    """What the chamber may do."""

    low: float = -10.0
    high: float = 50.0
    max_rate: float = 2.0
    """[°C/min]."""
    hours: float = 12.0


def within(plan: Plan, limits: Limits) -> Plan:
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
    """Return the segments with what goes nowhere joined to the dwell before it.

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
    limits: Limits,
    rng: np.random.Generator,
    evaluations: int,
) -> tuple[Plan, float]:
    """Exchange search: change, insert or drop one segment at a time, several starts."""
    best = within(PAPER, limits)
    best_value = promise(best)
    for start in range(STARTS):
        plan = best if start == 0 else within(Plan(_random_cycle(limits, rng), 4), limits)
        value = promise(plan)
        for _ in range(evaluations // STARTS):
            trial = _changed(plan, limits, rng)
            if trial is None:
                continue
            reached = promise(trial)
            if reached > value:
                plan, value = trial, reached
        if value > WORTH_IT * best_value + 1e-3:
            best, best_value = plan, value
    return best, best_value


def _random_segment(limits: Limits, rng: np.random.Generator) -> Segment:
    return Segment(
        float(np.round(rng.uniform(limits.low, limits.high))),
        float(rng.choice([0.5, 1.0, limits.max_rate, limits.max_rate])),
        float(rng.choice([300.0, 600.0, 1200.0, 1800.0, 3600.0])),
    )


def _random_cycle(limits: Limits, rng: np.random.Generator) -> tuple[Segment, ...]:
    inner = tuple(_random_segment(limits, rng) for _ in range(int(rng.integers(2, 5))))
    return _closed(inner, limits)


def _closed(inner: tuple[Segment, ...], limits: Limits) -> tuple[Segment, ...]:
    """Return the cycle ending at the reference temperature."""
    home = float(np.clip(REFERENCE_C, limits.low, limits.high))
    return (*inner, Segment(home, limits.max_rate, 900.0))


def _changed(plan: Plan, limits: Limits, rng: np.random.Generator) -> Plan | None:
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
