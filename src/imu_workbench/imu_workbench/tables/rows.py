# SPDX-License-Identifier: Apache-2.0
"""Rows of a published table of statistics, and a finding about them."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.recording import STANDARD_GRAVITY
from imu_recording.user_error import UserError

REQUIRED_COLUMNS = ('dut', 'quantity', 'axis', 'segment', 'min', 'max', 'mean', 'std')
LARGE_MEAN_SIGMA = 5.0
"""A channel is large where its mean is this many standard deviations from zero."""
ACCELERATION_FACTORS = {
    'm/s^2': 1.0, 'm/s²': 1.0, 'm/s2': 1.0, 'g': STANDARD_GRAVITY, 'mg': 1e-3 * STANDARD_GRAVITY,
}  # fmt: skip
"""Factors from the units tables are printed in to m/s²."""
FIELD_FACTORS = {
    'T': 1.0, 'mT': 1e-3, 'uT': 1e-6, 'µT': 1e-6, 'μT': 1e-6, 'nT': 1e-9,
    'G': 1e-4, 'gauss': 1e-4, 'Gauss': 1e-4, 'mG': 1e-7,
}  # fmt: skip
"""Factors from the units tables are printed in to T."""
SI_FACTORS = ACCELERATION_FACTORS | FIELD_FACTORS


class TableError(UserError):
    """A table that cannot be read; the message names the file and what is expected."""


@dataclass(frozen=True)
class StatisticsRow:
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

    @property
    def large(self) -> bool:
        """Whether it measures gravity or the field rather than an offset."""
        return self.quantity != 'gyroscope' and abs(self.mean) > LARGE_MEAN_SIGMA * max(
            self.std, 1e-300
        )

    @property
    def rounding(self) -> float:
        """Half of the last digit its numbers are printed with.

        >>> StatisticsRow('A', 'gyroscope', 'deg/s', 'x', 'R1', -0.02, 0.1, 0.05, 0.0).rounding
        0.005
        """
        numbers = (self.low, self.high, self.mean, self.std)
        digits = [Decimal(repr(float(value))).normalize().as_tuple().exponent for value in numbers]
        return 0.5 * 10.0 ** min(0, *(int(digit) for digit in digits))


def read_table(path: str | Path) -> list[StatisticsRow]:
    """Return the rows of a CSV with dut, quantity [unit], axis, segment, min, max, mean, std."""
    try:
        text = Path(path).read_text('utf-8-sig')
    except UnicodeDecodeError:
        raise TableError(f'{path}: not a text file') from None
    records = list(csv.DictReader(text.splitlines()))
    if not records:
        raise TableError(f'{path}: no rows')
    missing = [name for name in REQUIRED_COLUMNS if name not in records[0]]
    if missing:
        raise TableError(
            f'{path}: no column {missing[0]!r}; it needs {", ".join(REQUIRED_COLUMNS)}'
        )
    return [_row(record, f'{path}, row {k}') for k, record in enumerate(records, 2)]


def norms(rows: Iterable[StatisticsRow], quantity: str) -> dict[tuple[str, str], float]:
    """Return the norm of the mean vector per device and segment, where all its axes stand."""
    squares: dict[tuple[str, str], list[float]] = {}
    for row in rows:
        if row.quantity == quantity:
            squares.setdefault((row.dut, row.segment), []).append(row.mean**2)
    return {key: float(np.sqrt(sum(s))) for key, s in squares.items() if len(s) == 3}


def distinct(values: Iterable[tuple[str, ...]]) -> Sequence[tuple[str, ...]]:
    """Return the values once each, in the order of their first occurrence."""
    return list(dict.fromkeys(values))


def _row(record: Mapping[str, str], place: str) -> StatisticsRow:
    try:
        low, high, mean, std = (float(record[key]) for key in ('min', 'max', 'mean', 'std'))
    except (TypeError, ValueError):
        raise TableError(f'{place}: min, max, mean and std have to be numbers') from None
    if not np.isfinite([low, high, mean, std]).all():
        raise TableError(f'{place}: min, max, mean and std have to be finite')
    name, _, unit = (record['quantity'] or '').partition('[')
    return StatisticsRow(
        dut=record['dut'],
        quantity=name.strip().lower(),
        unit=unit.strip(' ]'),
        axis=record['axis'],
        segment=record['segment'],
        low=low,
        high=high,
        mean=mean,
        std=std,
    )


@dataclass(frozen=True)
class TableFinding:
    """Numbers that are impossible or need an explanation, and the possible explanations."""

    name: str
    where: tuple[str, ...]
    text: str
    explanations: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            'kind': 'data_quality',
            'name': self.name,
            'where': list(self.where),
            'text': self.text,
            'explanations': list(self.explanations),
        }
