# SPDX-License-Identifier: Apache-2.0
"""Columns of one device that stand in the table of another as well."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from thermal_comp.table_finding import TableFinding
from thermal_comp.table_rows import Row

Key = tuple[str, str, str]
Pair = tuple[Key, Key, int, int]
"""Two columns (quantity, device, segment), numbers that are the same, numbers compared."""
NUMBERS = 6
"""Mean and σ of three axes: fewer agree by chance."""
LIVELY = 5.0
"""A column says something where its numbers spread over this many last digits."""


def repeated_columns(rows: Sequence[Row]) -> list[TableFinding]:
    """Columns of one quantity that agree between devices in mean and σ of all axes.

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
        if a[0] != b[0] or a[1] == b[1] or len(one) != len(other) or len(one) < NUMBERS:
            continue
        last = digit[a[0]]
        differences = np.abs(np.array(one) - np.array(other))
        if differences.max() > 1.1 * last or np.ptp(one) < LIVELY * last:
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
