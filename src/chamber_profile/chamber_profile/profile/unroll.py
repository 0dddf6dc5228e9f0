# SPDX-License-Identifier: Apache-2.0
"""Unroll a profile: cycles and orientations become a plain sequence of steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

from chamber_profile.profile.values import OPERATOR_PHASE, Profile, Stabilisation, Step

REFERENCE_BAND_K = 2.0
"""A dwell this close to the first step's temperature is a reference dwell [K]."""
TURN_DURATION_S = 900.0
"""Expected time to open the chamber and turn the devices [s]."""


def signed_axis(axis: str) -> str:
    """Return the axis with its sign.

    >>> signed_axis('x'), signed_axis('-z')
    ('+x', '-z')
    """
    return axis if axis[0] in '+-' else f'+{axis}'


def unrolled_steps(content: Mapping[str, Any]) -> tuple[Step, ...]:
    """Return the steps of one run from checked content, cycles unrolled and counted."""
    steps: list[Step] = []
    for entry, cycle in _unrolled_entries(content):
        steps.append(_step(entry, cycle, content, steps))
    return tuple(steps)


def campaign_steps(profile: Profile) -> tuple[Step, ...]:
    """Return the steps of all orientations, an operator step before each further one."""
    orientations = profile.orientations or ('',)
    steps: list[Step] = []
    for number, orientation in enumerate(orientations):
        if number:
            steps.append(
                Step(
                    id=f'turn_{orientation}',
                    kind='operator',
                    target_c=max(profile.ambient_c, steps[-1].target_c),
                    rate_c_per_min=_slowest_rate(steps),
                    prompt=f'Turn the devices so that {orientation} points up, then confirm.',
                    expected_s=TURN_DURATION_S,
                    phase=OPERATOR_PHASE,
                )
            )
        steps += [replace(step, orientation=orientation) for step in profile.run_steps]
    return tuple(steps)


def closed_steps(profile: Profile) -> tuple[Step, ...]:
    """Return all steps, with a ramp to the safe temperature where they do not end there."""
    steps = campaign_steps(profile)
    last, safe = steps[-1], profile.on_abort
    if abs(last.target_c - safe.target_c) <= REFERENCE_BAND_K:
        return steps
    phase = _phase('ramp', last.target_c, safe.target_c, safe.target_c)
    criterion = Stabilisation(
        band_c=REFERENCE_BAND_K, timeout_s=safe.timeout_s, on_timeout='continue'
    )
    closing = Step(
        id='to_safe',
        kind='final',
        target_c=safe.target_c,
        rate_c_per_min=safe.rate_c_per_min,
        stabilise=criterion,
        phase=phase,
        orientation=last.orientation,
    )
    return (*steps, closing)


def _unrolled_entries(content: Mapping[str, Any]) -> list[tuple[Mapping[str, Any], int]]:
    entries = content['steps']
    ids = [entry['id'] for entry in entries]
    cycles = content.get('cycles', [])
    loops = {
        ids.index(cycle['from']): (ids.index(cycle['to']), cycle['count'])
        for cycle in (cycles if isinstance(cycles, list) else [cycles])
    }
    unrolled: list[tuple[Mapping[str, Any], int]] = []
    index = number = 0
    while index < len(entries):
        if index not in loops:
            unrolled.append((entries[index], 0))
            index += 1
            continue
        last, count = loops[index]
        for _ in range(count):
            number += 1
            unrolled += [(entry, number) for entry in entries[index : last + 1]]
        index = last + 1
    return unrolled


def _step(
    entry: Mapping[str, Any], cycle: int, content: Mapping[str, Any], before: list[Step]
) -> Step:
    kind = entry['kind']
    at = before[-1].target_c if before else float(entry['target_c'])
    target = float(entry.get('target_c', at))
    if kind == 'operator':
        target = max(target, float(content.get('ambient_c', 20.0)))
    reference = before[0].target_c if before else target
    stabilise = Stabilisation(**{**content.get('stabilise', {}), **entry.get('stabilise', {})})
    return Step(
        id=entry['id'],
        kind=kind,
        target_c=target,
        rate_c_per_min=float(entry.get('rate_c_per_min', _slowest_rate(before))),
        dwell_s=float(entry.get('dwell_s', 0.0)) if kind != 'ramp' else 0.0,
        dwell_mode=entry.get('dwell_mode', content.get('dwell_mode', 'guaranteed')),
        stabilise=None if kind in ('ramp', 'operator') else _as_floats(stabilise),
        prompt=entry.get('prompt', ''),
        expected_s=float(entry.get('expected_s', 0.0)),
        phase=_phase(kind, at, target, reference),
        cycle=cycle,
    )


def _slowest_rate(steps: list[Step]) -> float:
    """Return the slowest rate so far [°C/min]: used where the profile states none."""
    return min((step.rate_c_per_min for step in steps), default=1.0)


def _phase(kind: str, before: float, target: float, reference: float) -> str:
    if kind == 'ramp':
        return 'ramp_up' if target > before else 'ramp_down'
    if kind != 'dwell':
        return OPERATOR_PHASE if kind == 'operator' else kind
    if abs(target - reference) <= REFERENCE_BAND_K:
        return 'dwell_reference'
    return 'dwell_cold' if target < reference else 'dwell_hot'


def _as_floats(stabilise: Stabilisation) -> Stabilisation:
    numbers = {
        item.name: float(value)
        for item in fields(stabilise)
        if isinstance(value := getattr(stabilise, item.name), int | float)
    }
    return replace(stabilise, **numbers)  # type: ignore[arg-type]
