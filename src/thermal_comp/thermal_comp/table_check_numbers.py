# SPDX-License-Identifier: Apache-2.0
"""What a single row of a table cannot be."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from thermal_comp.table_finding import TableFinding
from thermal_comp.table_rows import Row

EXTREME_SIGMA = 20.0
"""No campaign is long enough for an extreme that far from the mean."""


def order_broken(rows: Iterable[Row]) -> list[TableFinding]:
    """Return rows whose minimum is above their maximum, or whose σ is negative."""
    return [
        TableFinding(
            'impossible_statistic',
            (r.place,),
            f'{r.place}: minimum {r.low:g}, maximum {r.high:g}, σ {r.std:g} cannot be',
            ('columns interchanged', 'a lost or added sign'),
        )
        for r in rows
        if r.low > r.high or r.std < 0.0
    ]


def mean_outside(rows: Iterable[Row]) -> list[TableFinding]:
    """Return rows whose mean is not between their extremes."""
    return [
        TableFinding(
            'impossible_statistic',
            (r.place,),
            f'{r.place}: mean {r.mean:g} is outside {r.low:g} … {r.high:g}',
            (
                'a misprint in mean, minimum or maximum',
                'extremes and mean are of different segments or channels',
                'a lost sign',
            ),
        )
        for r in rows
        if r.low <= r.high and not r.low - r.rounding <= r.mean <= r.high + r.rounding
    ]


def spread_beyond_range(rows: Iterable[Row]) -> list[TableFinding]:
    """σ² ≤ (max − mean)(mean − min) for any distribution (Bhatia and Davis)."""
    found = []
    for r in rows:
        above, below = r.high - r.mean + 2.0 * r.rounding, r.mean - r.low + 2.0 * r.rounding
        limit = float(np.sqrt(max(above, 0.0) * max(below, 0.0)))
        if r.low <= r.mean <= r.high and r.std - r.rounding > limit:
            found.append(
                TableFinding(
                    'impossible_statistic',
                    (r.place,),
                    f'{r.place}: σ {r.std:g} is larger than {limit:.3g}, the most that mean '
                    f'{r.mean:g} within {r.low:g} … {r.high:g} allows even with rounding',
                    (
                        'σ of another channel or segment',
                        'extremes after removal of outliers, σ before',
                        'a misprint',
                    ),
                )
            )
    return found


def extremes(rows: Iterable[Row]) -> list[TableFinding]:
    """Return rows with an extreme that neither noise nor a drift reaches."""
    found = []
    for r in rows:
        if r.std <= 0.0 or r.large or not r.low <= r.mean <= r.high:
            continue
        away = max(r.high - r.mean, r.mean - r.low)
        if away > EXTREME_SIGMA * (r.std + r.rounding):
            found.append(
                TableFinding(
                    'spikes',
                    (r.place,),
                    f'{r.place}: an extreme lies {away / r.std:.0f} σ from the mean',
                    ('a spike: bus error or bit error', 'a knock or a motion', 'a misprint'),
                )
            )
    return found
