# SPDX-License-Identifier: Apache-2.0
"""Bring topics of different rates and disordered stamps onto the rows of imu/data_raw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imu_recording.recording import FloatArray, IntArray

STALE_S = 60.0
"""A track that ended longer before the last row is worth a note [s]."""


@dataclass(frozen=True)
class Samples:
    """One topic's samples in order of time, every stamp once."""

    stamp: IntArray
    """(n,) strictly increasing [ns]."""
    values: tuple[FloatArray, ...]
    """(n, k) each."""
    notes: tuple[str, ...] = ()


def in_order(name: str, stamp: IntArray, values: tuple[FloatArray, ...]) -> Samples:
    """Sort samples by stamp; of those that share one keep the first read; say what was done."""
    notes: list[str] = []
    unset = int(np.count_nonzero(stamp == 0))
    if 1 < unset < len(stamp):
        kept = stamp != 0
        stamp, values = stamp[kept], tuple(v[kept] for v in values)
        notes.append(f'{name}: {unset} samples without a stamp left out')
    step = np.diff(stamp)
    if len(step) and step.min() <= 0:
        backward = int(np.count_nonzero(step < 0))
        order = np.argsort(stamp, kind='stable')
        stamp = stamp[order]
        first = np.ones(len(stamp), bool)
        first[1:] = np.diff(stamp) > 0
        taken = order[first]
        repeated = len(first) - len(taken)
        stamp, values = stamp[first], tuple(v[taken] for v in values)
        if backward:
            notes.append(f'{name}: stamps stepped back {backward} times; sorted by stamp')
        if repeated:
            notes.append(f'{name}: {repeated} samples with a repeated stamp left out')
    return Samples(stamp, values, tuple(notes))


def join_next(name: str, rows: IntArray, samples: Samples) -> tuple[FloatArray, tuple[str, ...]]:
    """Give each sample to the row of its stamp, else to the next row at most one period later.

    Where several reach one row the newest stays. Rows without a sample hold NaN; `rows` (n,) are
    stamps [ns], the period is their median step.
    """
    values = samples.values[0]
    if np.array_equal(rows, samples.stamp):
        return values, ()
    period = int(np.median(np.diff(rows))) if len(rows) > 1 else 0
    joined = np.full((len(rows), values.shape[1]), np.nan)
    row = np.searchsorted(rows, samples.stamp, side='left')
    reached = row < len(rows)
    delay = rows[np.minimum(row, len(rows) - 1)] - samples.stamp
    reached &= delay <= period
    row = row[reached]
    last = np.ones(len(row), bool)
    last[:-1] = row[1:] != row[:-1]
    joined[row[last]] = values[reached][last]
    lost = len(samples.stamp) - int(last.sum())
    notes = (f'{name}: {lost} of {len(samples.stamp)} samples found no row',) if lost else ()
    return joined, notes


def hold_newest(
    name: str, rows: IntArray, samples: Samples, *, event: bool = False
) -> tuple[tuple[FloatArray, ...], tuple[str, ...]]:
    """Give each row the newest sample not later than itself, NaN before the first.

    `event` marks tracks that are sent on change, whose silence at the end means nothing.
    """
    if np.array_equal(rows, samples.stamp):
        return samples.values, ()
    newest = np.searchsorted(samples.stamp, rows, side='right') - 1
    before = newest < 0
    newest[before] = 0
    held = tuple(values[newest] for values in samples.values)
    for values in held:
        values[before] = np.nan
    notes: list[str] = []
    late = int(np.count_nonzero(samples.stamp > rows[-1]))
    if not event and late:
        notes.append(f'{name}: {late} of {len(samples.stamp)} samples found no row')
    if before.any() and not event:
        notes.append(f'{name}: {int(before.sum())} rows lie before its first sample')
    silence = (rows[-1] - samples.stamp[-1]) * 1e-9
    if not event and silence > _allowed(samples.stamp):
        notes.append(f'{name} ends {silence:.0f} s before the last row, its last value is held')
    return held, tuple(notes)


def _allowed(stamp: IntArray) -> float:
    step = float(np.median(np.diff(stamp))) * 1e-9 if len(stamp) > 1 else 0.0
    return max(STALE_S, 10.0 * step)
