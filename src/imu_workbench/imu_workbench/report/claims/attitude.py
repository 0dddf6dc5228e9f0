# SPDX-License-Identifier: Apache-2.0
"""Claims of section VI: what compensation does to the attitude of a resting device."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from thermal_comp.presentation.display import shown

from imu_workbench.report.attitude import EULER, FilterAttitude
from imu_workbench.report.claims.claim import Claim, untestable

TOO_SLOW_FOR_FILTERS = (
    'The filters need samples at 50 Hz or more; these recordings are slower and were interpolated.'
)
Attitudes = Mapping[str, Sequence[FilterAttitude]]
"""Attitudes per run."""


def attitude_claims(
    attitudes: Attitudes, state_bytes: Mapping[str, int], *, interpolated: bool = False
) -> list[Claim]:
    """Return the claims about the two filters.

    Attitudes of `interpolated` samples are shown without a verdict; what a filter costs does not
    depend on where its samples come from.
    """
    claims = [
        spread_claim(attitudes),
        order_of_magnitude_claim(attitudes),
        mean_claim(attitudes),
        worse_filter_claim(attitudes),
    ]
    if interpolated:
        claims = [without_verdict(claim) for claim in claims]
    return [*claims, cost_claim(attitudes, state_bytes)]


def without_verdict(claim: Claim) -> Claim:
    """Return a claim whose numbers are of interpolated samples."""
    if claim.verdict == 'untestable':
        return claim
    ours = f'interpolated, so without a verdict: {claim.ours}'
    return replace(claim, ours=ours, verdict='untestable', why=TOO_SLOW_FOR_FILTERS)


def spread_claim(attitudes: Attitudes) -> Claim:
    """Compare standard deviations raw and compensated."""
    said = 'The standard deviation of every Euler angle shrinks with compensation (Tables VI, VII)'
    factors = spread_factors(attitudes)
    if not factors:
        return untestable('spread', said, TOO_SLOW_FOR_FILTERS)
    cycles = cycle_factors(attitudes)
    values = [f for row in factors for f in row['factor'].values()]
    held = sum(value > 1.0 for value in values)
    return Claim(
        key='spread',
        claim=said,
        ours=f'{held} of {len(values)} standard deviations over the run shrink, by factors of '
        f'{shown(min(values))} … {shown(max(values))}{_within_cycles(cycles)}',
        verdict='supported' if held == len(values) else 'not',
        why=(
            'Factor σ raw / σ compensated, per run, filter and angle; the verdict is on whole '
            'runs.'
        ),
        numbers={'factors': factors, 'cycles': cycles},
    )


def order_of_magnitude_claim(attitudes: Attitudes) -> Claim:
    """Compare the complementary filter's factors with ten."""
    said = (
        'With the complementary filter every standard deviation shrinks by more than one order '
        'of magnitude (section VI C; the paper’s own Tables VI and VII give 2.5 … 34)'
    )
    rows = [row for row in spread_factors(attitudes) if row['filter'] == 'complementary']
    if not rows:
        return untestable('order_of_magnitude', said, TOO_SLOW_FOR_FILTERS)
    values = [f for row in rows for f in row['factor'].values()]
    return Claim(
        key='order_of_magnitude',
        claim=said,
        ours=f'factors of {shown(min(values))} … {shown(max(values))}; '
        f'{sum(value > 10.0 for value in values)} of {len(values)} are above ten',
        verdict='supported' if min(values) > 10.0 else 'not',
        why='Smallest factor against ten.',
    )


def mean_claim(attitudes: Attitudes) -> Claim:
    """Compare the mean angles relative to the start, raw and compensated."""
    said = (
        'Compensation makes the estimate more accurate (conclusion; in the paper the mean β of '
        'the AHRS gets worse for two of three devices)'
    )
    rows: list[dict[str, Any]] = []
    for run, name, raw, compensated in _pairs(attitudes):
        means = {a: (abs(raw['mean'][a]), abs(compensated['mean'][a])) for a in EULER}
        rows.append({'run': run, 'filter': name, 'mean_deg': means})
    if not rows:
        return untestable('mean', said, TOO_SLOW_FOR_FILTERS)
    pairs = [pair for row in rows for pair in row['mean_deg'].values()]
    held = sum(after < before for before, after in pairs)
    largest = (max(b for b, _ in pairs), max(a for _, a in pairs))
    return Claim(
        key='mean',
        claim=said,
        ours=(
            f'{held} of {len(pairs)} mean angles move towards the start attitude; the largest '
            f'goes from {shown(largest[0])}° to {shown(largest[1])}°'
        ),
        verdict='supported' if held == len(pairs) else 'not',
        why=(
            'Mean angle relative to the attitude of the first minute: a resting device should '
            'stay.'
        ),
        numbers={'means': rows},
    )


def worse_filter_claim(attitudes: Attitudes) -> Claim:
    """Compare the filters on raw data, and raw with only the magnetometer compensated."""
    said = (
        'On raw data the AHRS is worse than the complementary filter, probably because it trusts '
        'the magnetometer more (section VI C)'
    )
    rows = []
    for run, found in attitudes.items():
        spread = {
            (a.filter, a.data): a.statistics[0].get('std', {}).get('rotation') for a in found
        }
        names = sorted({a.filter for a in found})
        row: dict[str, Any] = {'run': run}
        for name in names:
            raw = spread.get((name, 'raw'))
            without = spread.get((name, 'magnetometer compensated'))
            if raw is None:
                continue
            row[name] = {'raw_deg': raw}
            if without is not None:
                share = float(np.sqrt(max(0.0, raw**2 - without**2)))
                row[name] |= {'magnetometer_compensated_deg': without, 'magnetometer_deg': share}
        if 'ahrs' in row and 'complementary' in row:
            rows.append(row)
    if not rows:
        return untestable('worse_filter', said, TOO_SLOW_FOR_FILTERS)
    worse = sum(row['ahrs']['raw_deg'] > row['complementary']['raw_deg'] for row in rows)
    first = rows[0]
    due = ', '.join(
        f'{label} {shown(first[name]["magnetometer_deg"])}°'
        for name, label in (('ahrs', 'AHRS'), ('complementary', 'complementary'))
        if 'magnetometer_deg' in first[name]
    )
    due = f'; of that the magnetometer makes {due}' if due else ''
    return Claim(
        key='worse_filter',
        claim=said,
        ours=f'σ of the rotation angle on raw data: AHRS {shown(first["ahrs"]["raw_deg"])}°, '
        f'complementary {shown(first["complementary"]["raw_deg"])}° ({first["run"]}){due}',
        verdict='supported' if worse == len(rows) else 'not',
        why='The magnetometer’s share is √(σ² raw − σ² with only the magnetometer compensated).',
        numbers={'runs': rows},
    )


def cost_claim(attitudes: Attitudes, state_bytes: Mapping[str, int]) -> Claim:
    """Compare time and memory of the filters."""
    said = 'The AHRS needs more computing than the complementary filter (section VI B)'
    cost: dict[str, float] = {}
    for found in attitudes.values():
        for one in found:
            cost[one.filter] = min(
                cost.get(one.filter, np.inf), one.nanoseconds_per_sample
            )  # the best of several is the least disturbed
    if not {'ahrs', 'complementary'} <= cost.keys():
        return untestable('cost', said, TOO_SLOW_FOR_FILTERS)
    ratio = cost['ahrs'] / cost['complementary']
    return Claim(
        key='cost',
        claim=said,
        ours=f'AHRS {shown(cost["ahrs"])} ns per sample and {state_bytes["ahrs"]} bytes of state, '
        f'complementary {shown(cost["complementary"])} ns and '
        f'{state_bytes["complementary"]} bytes (× {shown(ratio, 2)})',
        verdict='supported' if ratio > 1.0 else 'not',
        why='Compiled kernels on this machine, best of the runs over the recordings.',
        numbers={'nanoseconds_per_sample': cost, 'state_bytes': dict(state_bytes)},
    )


def _within_cycles(cycles: Sequence[Mapping[str, Any]]) -> str:
    values = [f for row in cycles for f in row['factor'].values()]
    if not values:
        return ''
    held = sum(value > 1.0 for value in values)
    return (
        f'; within the cycles {held} of {len(values)}, by {shown(min(values))} … '
        f'{shown(max(values))}'
    )


def cycle_factors(attitudes: Attitudes) -> list[dict[str, Any]]:
    """Return σ raw / σ compensated of every cycle by itself, per run, filter and Euler angle."""
    rows = []
    for run, found in attitudes.items():
        parts = {(a.filter, a.data): {p['part']: p for p in a.statistics[1:]} for a in found}
        for name in dict.fromkeys(a.filter for a in found):
            after = parts[name, 'compensated']
            rows += [
                {'run': run, 'filter': name, 'cycle': cycle, 'factor': _factors(raw, after[cycle])}
                for cycle, raw in parts[name, 'raw'].items()
                if 'std' in raw and 'std' in after[cycle]
            ]
    return rows


def _factors(raw: Mapping[str, Any], compensated: Mapping[str, Any]) -> dict[str, float]:
    return {a: raw['std'][a] / max(compensated['std'][a], 1e-12) for a in EULER}


def spread_factors(attitudes: Attitudes) -> list[dict[str, Any]]:
    """Return σ raw / σ compensated per run, filter and Euler angle."""
    return [
        {
            'run': run,
            'filter': name,
            'factor': _factors(raw, compensated),
        }
        for run, name, raw, compensated in _pairs(attitudes)
    ]


def _pairs(attitudes: Attitudes) -> list[tuple[str, str, dict[str, Any], dict[str, Any]]]:
    pairs = []
    for run, found in attitudes.items():
        by_place = {(a.filter, a.data): a.statistics[0] for a in found}
        for name in dict.fromkeys(a.filter for a in found):
            raw, compensated = by_place[name, 'raw'], by_place[name, 'compensated']
            if 'std' in raw and 'std' in compensated:
                pairs.append((run, name, raw, compensated))
    return pairs
