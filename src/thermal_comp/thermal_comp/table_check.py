# SPDX-License-Identifier: Apache-2.0
"""Published statistics under the microscope: what cannot be, and what may explain it."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

REQUIRED = ('dut', 'quantity', 'axis', 'segment', 'min', 'max', 'mean', 'std')
STARTUP_AGREEMENT = 0.02
"""Channels of one device share a start-up if their ratios agree to this."""
LARGE = 5.0
"""A channel is large where its mean is this many standard deviations from zero."""
EXTREME_SIGMA = 20.0
EARTH_FIELD_UT = (20.0, 70.0)
FIELD_JUMP = 1.3
SAME_ROWS = 0.011
"""Numbers printed with two digits agree to this."""


class TableError(ValueError):
    """A table that cannot be read; the message names the file and what is expected."""


@dataclass(frozen=True)
class Row:
    """Statistics of one channel in one segment."""

    dut: str
    quantity: str
    """Sensor, without the unit."""
    unit: str
    axis: str
    segment: str
    low: float
    high: float
    mean: float
    std: float

    @property
    def place(self) -> str:
        """Where the row stands."""
        return f'{self.dut} {self.quantity} {self.axis} {self.segment}'


@dataclass(frozen=True)
class TableFinding:
    """Something the numbers say about themselves."""

    name: str
    where: tuple[str, ...]
    text: str
    explanations: tuple[str, ...]

    def content(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            'kind': 'data_quality',
            'name': self.name,
            'where': list(self.where),
            'text': self.text,
            'explanations': list(self.explanations),
        }


def read_table(path: str | Path) -> list[Row]:
    """Return the rows of a CSV with dut, quantity [unit], axis, segment, min, max, mean, std."""
    try:
        text = Path(path).read_text('utf-8')
    except UnicodeDecodeError:
        raise TableError(f'{path}: not a text file') from None
    records = list(csv.DictReader(text.splitlines()))
    if not records:
        raise TableError(f'{path}: no rows')
    missing = [name for name in REQUIRED if name not in records[0]]
    if missing:
        raise TableError(f'{path}: no column {missing[0]!r}; it needs {", ".join(REQUIRED)}')
    return [_row(record, f'{path}, row {k}') for k, record in enumerate(records, 2)]


def check_rows(rows: Sequence[Row]) -> list[TableFinding]:
    """Return everything that cannot be or that asks for an explanation."""
    return [
        *_mean_outside(rows),
        *_spread_beyond_range(rows),
        *_extremes(rows),
        *_startups(rows),
        *_flips(rows),
        *_units(rows),
        *_field_jumps(rows),
        *_repeated_columns(rows),
    ]


def _row(record: Mapping[str, str], place: str) -> Row:
    name, _, unit = record['quantity'].partition('[')
    try:
        low, high, mean, std = (float(record[key]) for key in ('min', 'max', 'mean', 'std'))
    except (TypeError, ValueError):
        raise TableError(f'{place}: min, max, mean and std have to be numbers') from None
    return Row(
        record['dut'], name.strip(), unit.strip(' ]'), record['axis'], record['segment'],
        low, high, mean, std,
    )  # fmt: skip


def _mean_outside(rows: Iterable[Row]) -> list[TableFinding]:
    return [
        TableFinding(
            'impossible_statistic',
            (r.place,),
            f'{r.place}: mean {r.mean:g} is outside {r.low:g} … {r.high:g}',
            (
                'a misprint in mean, minimum or maximum',
                'the extremes and the mean are of different segments',
            ),
        )
        for r in rows
        if not r.low <= r.mean <= r.high
    ]


def _spread_beyond_range(rows: Iterable[Row]) -> list[TableFinding]:
    """σ² ≤ (max − mean)(mean − min) for any distribution (Bhatia and Davis)."""
    found = []
    for r in rows:
        half = 0.5 * 10.0 ** -_decimals(r)
        above, below = r.high - r.mean + 2.0 * half, r.mean - r.low + 2.0 * half
        limit = float(np.sqrt(max(above, 0.0) * max(below, 0.0)))
        if r.low <= r.mean <= r.high and r.std - half > limit:
            found.append(
                TableFinding(
                    'impossible_statistic',
                    (r.place,),
                    f'{r.place}: σ {r.std:g} is larger than {limit:.3g}, the most that mean '
                    f'{r.mean:g} within {r.low:g} … {r.high:g} allows even with rounding',
                    ('σ of another channel or segment', 'extremes after removal of outliers'),
                )
            )
    return found


def _extremes(rows: Iterable[Row]) -> list[TableFinding]:
    found = []
    for r in rows:
        if r.std <= 0.0 or _large(r):
            continue
        sigma = max(r.high - r.mean, r.mean - r.low) / r.std
        if sigma > EXTREME_SIGMA:
            found.append(
                TableFinding(
                    'spikes',
                    (r.place,),
                    f'{r.place}: an extreme lies {sigma:.0f} σ from the mean',
                    ('a spike: bus error or bit error', 'a knock or a motion', 'a misprint'),
                )
            )
    return found


def _startups(rows: Sequence[Row]) -> list[TableFinding]:
    """All large channels of a device reach down to the same share of their mean."""
    found = []
    for dut, segment in dict.fromkeys((r.dut, r.segment) for r in rows):
        mine = [r for r in rows if (r.dut, r.segment) == (dut, segment) and _large(r)]
        if len(mine) < 3:
            continue
        ratio = np.array([_inner_extreme(r) / r.mean for r in mine])
        common = float(np.median(ratio))
        share = np.abs(ratio - common) <= STARTUP_AGREEMENT
        if common > 0.9 or share.sum() < 3:
            continue
        spread = np.array([abs(r.std / r.mean) for r in mine])[share]
        found.append(
            TableFinding(
                'startup_transient',
                tuple(r.place for r, ok in zip(mine, share, strict=True) if ok),
                f'{dut} {segment}: {int(share.sum())} of {len(mine)} large channels start at the '
                f'same {common:.3f} of their mean (σ/mean {spread.min():.3f} … '
                f'{spread.max():.3f}): neither temperature nor motion scales gravity and field '
                'alike',
                (
                    'a filter that started at zero and filled up',
                    'first samples averaged with zeros',
                    'a common scale that settled (supply, reference)',
                ),
            )
        )
    return found


def _flips(rows: Sequence[Row]) -> list[TableFinding]:
    found = []
    for dut, quantity, axis in dict.fromkeys((r.dut, r.quantity, r.axis) for r in rows):
        if quantity != 'accelerometer':
            continue
        mine = [r for r in rows if (r.dut, r.quantity, r.axis) == (dut, quantity, axis)]
        heavy = [r for r in mine if abs(r.mean) > 5.0]
        usual = np.sign(np.median([r.mean for r in heavy])) if heavy else 0.0
        other = [r for r in heavy if np.sign(r.mean) != usual]
        if other:
            found.append(
                TableFinding(
                    'orientation_flip',
                    tuple(r.place for r in other),
                    f'{dut} accelerometer {axis}: gravity changes its sign in '
                    f'{", ".join(r.segment for r in other)} (mean {other[0].mean:g} m/s²)',
                    (
                        'the device was remounted upside down',
                        'a sign error in the processing',
                        'the column belongs to another device',
                    ),
                )
            )
    return found


def _units(rows: Sequence[Row]) -> list[TableFinding]:
    """The Earth's field is 20 to 70 µT; a table in nT cannot hold a norm of 40."""
    found = []
    for unit in dict.fromkeys(r.unit for r in rows if r.quantity == 'magnetometer'):
        norms = [n for (_, _), n in _norms([r for r in rows if r.unit == unit]).items()]
        low, high = EARTH_FIELD_UT
        in_micro = [n * _TO_MICROTESLA.get(unit, 1.0) for n in norms]
        middle = float(np.median(in_micro)) if in_micro else low
        if not low / 2.0 <= middle <= high * 2.0:
            found.append(
                TableFinding(
                    'unit_mismatch',
                    (f'magnetometer [{unit}]',),
                    f'magnetometer in {unit}: the median norm is {middle:.3g} µT, the Earth has '
                    f'{low:g} … {high:g}',
                    ('the unit is wrong; µT would fit', 'a shielded chamber'),
                )
            )
        elif unit in {'uT', 'µT'}:
            found.append(
                TableFinding(
                    'unit_mismatch',
                    (f'magnetometer [{unit}]',),
                    f'magnetometer: only µT makes the median norm of {middle:.3g} possible; '
                    'nT, as columns of this size are sometimes labelled, would be a thousandth '
                    "of the Earth's field",
                    ('µT is right; a label nT is a misprint',),
                )
            )
    return found


_TO_MICROTESLA = {'nT': 1e-3, 'uT': 1.0, 'µT': 1.0, 'T': 1e6, 'G': 100.0, 'mG': 0.1}


def _field_jumps(rows: Sequence[Row]) -> list[TableFinding]:
    found = []
    fields, forces = _norms(rows), _norms(rows, 'accelerometer')
    for dut in dict.fromkeys(r.dut for r in rows):
        norms = {segment: n for (d, segment), n in fields.items() if d == dut}
        if len(norms) < 2 or max(norms.values()) < FIELD_JUMP * min(norms.values()):
            continue
        forces_here = [n for (d, _), n in forces.items() if d == dut]
        steady = f'{min(forces_here):.2f} … {max(forces_here):.2f} m/s²' if forces_here else '?'
        shown = ', '.join(f'{segment} {n:.0f}' for segment, n in norms.items())
        found.append(
            TableFinding(
                'field_jump',
                tuple(f'{dut} magnetometer {segment}' for segment in norms),
                f"{dut}: the mean field's norm changes between segments ({shown}) while "
                f'specific force stays {steady}: no temperature coefficient does that',
                (
                    'a hard-iron offset or a field that is new in each session',
                    'columns of different devices or files mixed up',
                    'the device was moved between segments',
                ),
            )
        )
    return found


def _repeated_columns(rows: Sequence[Row]) -> list[TableFinding]:
    """Columns of one quantity that agree between devices in mean and σ of all axes."""
    columns: dict[tuple[str, str, str], list[float]] = {}
    for r in sorted(rows, key=lambda r: r.axis):
        columns.setdefault((r.quantity, r.dut, r.segment), []).extend([r.mean, r.std])
    pairs = []
    for (a, one), (b, other) in combinations(columns.items(), 2):
        if a[0] == b[0] and a[1] != b[1] and len(one) == len(other) >= 6:
            differences = np.abs(np.array(one) - np.array(other))
            if differences.max() <= SAME_ROWS and np.ptp(one) > 5.0 * SAME_ROWS:
                pairs.append((a, b, int((differences < 1e-9).sum()), len(one)))
    if not pairs:
        return []
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


def _norms(rows: Sequence[Row], quantity: str = 'magnetometer') -> dict[tuple[str, str], float]:
    squares: dict[tuple[str, str], float] = {}
    for r in rows:
        if r.quantity == quantity:
            key = (r.dut, r.segment)
            squares[key] = squares.get(key, 0.0) + r.mean**2
    return {key: float(np.sqrt(value)) for key, value in squares.items()}


def _inner_extreme(r: Row) -> float:
    """The extreme on the side of zero."""
    return r.low if r.mean > 0.0 else r.high


def _large(r: Row) -> bool:
    return r.quantity != 'gyroscope' and abs(r.mean) > LARGE * max(r.std, 1e-12)


def _decimals(r: Row) -> int:
    texts = [f'{value:g}' for value in (r.low, r.high, r.mean, r.std)]
    return max((len(text.partition('.')[2]) for text in texts), default=0)
