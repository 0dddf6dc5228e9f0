# SPDX-License-Identifier: Apache-2.0
"""Checks of a table of statistics: impossible numbers, columns that two devices share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np

from imu_workbench.tables.channels import field_jumps, flips, startups, units
from imu_workbench.tables.rows import StatisticsRow, TableError, TableFinding, read_table

EXTREME_SIGMA = 20.0
"""Distance of an extreme from the mean that no campaign is long enough for [σ]."""


def order_broken(rows: Iterable[StatisticsRow]) -> list[TableFinding]:
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


def mean_outside(rows: Iterable[StatisticsRow]) -> list[TableFinding]:
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


def spread_beyond_range(rows: Iterable[StatisticsRow]) -> list[TableFinding]:
    """Return rows whose σ² exceeds (max − mean)(mean − min), its bound (Bhatia and Davis)."""
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


def extremes(rows: Iterable[StatisticsRow]) -> list[TableFinding]:
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


Key = tuple[str, str, str]
Pair = tuple[Key, Key, int, int]
"""Two columns (quantity, device, segment), numbers that are the same, numbers compared."""
LEAST_NUMBERS = 6
"""Mean and σ of three axes: fewer agree by chance."""
LEAST_SPREAD_DIGITS = 5.0
"""Spread of a column, in units of the last digit, from which equal numbers are no chance."""


def repeated_columns(rows: Sequence[StatisticsRow]) -> list[TableFinding]:
    """Return columns of one quantity that agree between devices in mean and σ of all axes.

    Columns that differ in last digits only count where others agree wholly.
    """
    columns: dict[Key, list[float]] = {}
    digit: dict[str, float] = {}
    for r in sorted(rows, key=lambda r: r.axis):
        columns.setdefault((r.quantity, r.dut, r.segment), []).extend([r.mean, r.std])
        digit[r.quantity] = min(digit.get(r.quantity, np.inf), 2.0 * r.rounding)
    exact: list[Pair] = []
    near: list[Pair] = []
    for (a, one), (b, other) in combinations(columns.items(), 2):
        if a[0] != b[0] or a[1] == b[1] or len(one) != len(other) or len(one) < LEAST_NUMBERS:
            continue
        last = digit[a[0]]
        differences = np.abs(np.array(one) - np.array(other))
        if differences.max() > 1.1 * last or np.ptp(one) < LEAST_SPREAD_DIGITS * last:
            continue
        same = int((differences < 0.1 * last).sum())
        (exact if same == len(one) else near).append((a, b, same, len(one)))
    if not exact:
        return []
    pairs = [*exact, *near]
    text = '; '.join(
        f'{a[1]} {a[2]} = {b[1]} {b[2]} ({same} of {count} numbers)' for a, b, same, count in pairs
    )
    quantities = ', '.join(dict.fromkeys(a[0] for a, _, _, _ in pairs))
    return [
        TableFinding(
            'repeated_columns',
            tuple(f'{k[1]} {k[0]} {k[2]}' for pair in pairs for k in pair[:2]),
            f'{quantities}: columns of different devices agree in mean and σ of all axes: {text}',
            (
                'boards permuted between the tables rather than repetitions of one board',
                'columns copied by mistake',
                'one file read for several devices',
            ),
        )
    ]


__all__ = ['StatisticsRow', 'TableError', 'TableFinding', 'check_rows', 'read_table']

CHECKS = (
    order_broken,
    mean_outside,
    spread_beyond_range,
    extremes,
    startups,
    flips,
    units,
    field_jumps,
    repeated_columns,
)
"""Single rows first, then the rows of one device, then devices beside each other."""


def check_rows(rows: Sequence[StatisticsRow]) -> list[TableFinding]:
    """Return the findings of all checks."""
    return [finding for check in CHECKS for finding in check(rows)]
