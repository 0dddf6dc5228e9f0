# SPDX-License-Identifier: Apache-2.0
"""Bring topics of different rates and disordered stamps onto the rows of imu/data_raw."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from imu_recording.recording import FloatArray, IntArray, RecordingError

ROWS_PER_BLOCK = 1 << 18
"""Rows joined at a time."""
MOST_UNNOTED_SAMPLES = 2
"""Samples without a row that are not noted: topics do not end at the same instant."""
STALE_TRACK_S = 60.0
"""Time from the end of a track to the last row from which it is noted [s]."""
LONGEST_GAP_S = 6 * 3600.0
"""Longest gap in a run [s], unless it is shorter than LONGEST_GAP_STEPS usual steps; a longer one
means that the clock was set, or another run."""
LONGEST_GAP_STEPS = 100.0
LEAST_BURSTS = 5
"""Stretches from which a recording is of bursts, if most last no more than …"""
LARGEST_BURST_SHARE = 0.1
"""… this share of the gaps between them …"""
LARGEST_BURST_GAP_RATIO, LONGEST_BURST_GAP_S = 3.0, 7 * 86_400.0
"""… and their longest gap, over the usual one; none is longer than a week [s]."""
LARGEST_SPAN_RATIO = 100.0
"""Largest ratio of the stamps' span to the time that the samples account for."""
LEAST_FILLED_S = 20.0
"""Least time that one sample accounts for [s]."""
CLOCK_BACK_S = 1.0
"""A step back of the stamps from which the clock may have been set back [s]."""
LONGEST_MEDIAN_STEP_S = 3600.0
"""Longest median step of right stamps [s]."""
LARGEST_DISORDER_SHARE = 0.25
"""Largest share of steps that go back; two publishers on one topic, and noise, make half."""
LEAST_SAMPLES_IN_DISORDER = 100
"""Number of samples from which that share is taken."""
LONGEST_BRIDGE_PERIODS = 3.0
"""Longest distance of two samples that is interpolated [periods]."""
MOST_CLOCK_STEPS = 10
"""Most steps back that may be a clock that was set; more are disorder."""
CLOCK_SET_BACK = 'the clock was set back'
"""Text of the note about it."""


@dataclass(frozen=True)
class Samples:
    """One topic's samples in order of time, every stamp once."""

    stamp: IntArray
    """(n,) strictly increasing [ns]."""
    values: tuple[FloatArray | IntArray, ...]
    """(n, k) each."""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Joined:
    """One topic's values on the rows."""

    values: tuple[FloatArray | IntArray, ...]
    """(rows, k) each."""
    unplaced: int = 0
    """Samples that found no row."""
    notes: tuple[str, ...] = ()


def in_order(name: str, stamp: IntArray, values: Sequence[FloatArray]) -> Samples:
    """Sort samples by stamp, keep the first read of those that share one, note what was done."""
    groups = list(values)
    notes: list[str] = []
    unset = int(np.count_nonzero(stamp == 0))
    if 1 < unset < len(stamp):
        kept = np.flatnonzero(stamp)
        stamp = _taken(stamp, groups, kept)
        notes.append(f'{name}: {unset} samples without a stamp left out')
    back = int(np.count_nonzero(np.diff(stamp) < 0))
    if len(stamp) >= LEAST_SAMPLES_IN_DISORDER and back > LARGEST_DISORDER_SHARE * len(stamp):
        raise RecordingError(
            f'{name}: stamps step back {back} times in {len(stamp)} samples: are there two '
            'publishers on this topic, or are the stamps damaged?'
        )
    stamp, twice = _one_clock(name, stamp, groups)
    notes += twice
    step = np.diff(stamp)
    if len(step) and step.min() <= 0:
        backward = int(np.count_nonzero(step < 0))
        del step
        order = np.argsort(stamp, kind='stable')
        first = np.ones(len(stamp), bool)
        first[1:] = np.diff(stamp[order]) > 0
        repeated = len(stamp) - int(np.count_nonzero(first))
        stamp = _taken(stamp, groups, order[first])
        if backward:
            notes.append(f'{name}: stamps stepped back {backward} times; sorted by stamp')
        if repeated:
            notes.append(f'{name}: {repeated} samples with a repeated stamp left out')
    return Samples(stamp, tuple(groups), tuple(notes))


def _one_clock(name: str, stamp: IntArray, groups: list[FloatArray]) -> tuple[IntArray, list[str]]:
    """Leave out times that a clock set back stamped twice: of two stretches the longer one stays.

    Stretches that are only in another order than they were read need no more than sorting.
    """
    back = np.flatnonzero(np.diff(stamp) < -CLOCK_BACK_S * 1e9)
    if not 0 < len(back) <= MOST_CLOCK_STEPS:
        return stamp, []
    edges = [0, *(back + 1).tolist(), len(stamp)]
    stretches = [np.arange(a, b) for a, b in itertools.pairwise(edges)]
    kept: list[IntArray] = []
    for rows in sorted(stretches, key=len, reverse=True):
        own = np.ones(len(rows), bool)
        for other in kept:
            low, high = stamp[other].min(), stamp[other].max()
            own &= (stamp[rows] < low) | (stamp[rows] > high)
        # One late message is no clock that was set back.
        own |= len(rows) <= MOST_UNNOTED_SAMPLES
        if own.any():
            kept.append(rows[own])
    order = np.sort(np.concatenate(kept))
    lost = len(stamp) - len(order)
    if lost <= MOST_UNNOTED_SAMPLES:
        return stamp, []
    furthest = -float(np.diff(stamp).min()) * 1e-9
    note = (
        f'{name}: {CLOCK_SET_BACK} {len(back)} times, by up to {furthest:.6g} s: '
        f'{lost} samples of times that were stamped twice left out'
    )
    return _taken(stamp, groups, order), [note]


def without_jumps(name: str, samples: Samples) -> Samples:
    """Return the longest stretch of samples between jumps of their stamps; note what is cut.

    >>> years = np.array([5, 6, 1_700_000_000, 1_700_000_001, 1_700_000_002]) * 10**9
    >>> without_jumps('imu', Samples(years, ())).notes[0]
    'imu: stamps jump 1 time, by 53.9 years: 2 of 5 samples outside the longest stretch left out'
    """
    kept, note = longest_stretch(name, samples.stamp)
    if not note:
        return samples
    values = tuple(group[kept] for group in samples.values)
    return Samples(samples.stamp[kept], values, (*samples.notes, note))


def longest_stretch(name: str, stamp: IntArray) -> tuple[slice, str]:
    """Return the rows of the longest stretch between jumps of the stamps, and what is cut.

    A clock that is set while it is recorded, a stamp that was never set and damaged ones leave
    years between two samples. Raises RecordingError where the samples that stay are spread so
    thinly that their stamps cannot be right.
    """
    step = np.diff(stamp) * 1e-9
    usual = float(np.median(step)) if len(step) else 0.0
    apart = _longest_between_bursts(stamp)
    jumps = np.flatnonzero(step > max(LONGEST_GAP_S, LONGEST_GAP_STEPS * usual, apart))
    kept, note = slice(0, len(stamp)), ''
    if len(jumps):
        edges = np.array([0, *(jumps + 1), len(stamp)])
        longest = int(np.argmax(np.diff(edges)))
        kept = slice(int(edges[longest]), int(edges[longest + 1]))
        left_out = len(stamp) - (kept.stop - kept.start)
        note = (
            f'{name}: stamps jump {len(jumps)} time{"s" * (len(jumps) > 1)}, by '
            f'{"up to " * (len(jumps) > 1)}{_span(float(step[jumps].max()))}: {left_out} of '
            f'{len(stamp)} samples outside the longest stretch left out'
        )
        stamp, step = stamp[kept], step[kept.start : kept.stop - 1]
    span = float(stamp[-1] - stamp[0]) * 1e-9 if len(stamp) else 0.0
    filled = len(stamp) * max(LEAST_FILLED_S, float(np.median(step)) if len(step) else 0.0)
    thin = span > LARGEST_SPAN_RATIO * filled and not apart
    if thin or usual > LONGEST_MEDIAN_STEP_S:
        raise RecordingError(
            f'{name}: {len(stamp)} samples over {_span(span)}: the stamps cannot be right; were '
            'they damaged, or written in another unit than nanoseconds?'
        )
    return kept, note


def _longest_between_bursts(stamp: IntArray) -> float:
    """Return the longest gap between bursts of samples [s]; 0 where the samples are none.

    >>> seconds = np.repeat(7 * 3600 * np.arange(6), 3) + np.tile(np.arange(3), 6)
    >>> round(_longest_between_bursts(seconds * 10**9))
    75594
    """
    step = np.diff(stamp) * 1e-9
    ends = np.flatnonzero(step > LONGEST_GAP_STEPS * float(np.median(step))) if len(step) else step
    if len(ends) + 1 < LEAST_BURSTS:
        return 0.0
    first, last = np.append(0, ends + 1), np.append(ends, len(stamp) - 1)
    gap = float(np.median(step[ends]))
    if float(np.median(stamp[last] - stamp[first])) * 1e-9 > LARGEST_BURST_SHARE * gap:
        return 0.0
    return min(LARGEST_BURST_GAP_RATIO * gap, LONGEST_BURST_GAP_S)


def _span(seconds: float) -> str:
    """Return a time in the unit it is read in.

    >>> _span(86400.0), _span(3.2e8)
    ('24 h', '10.1 years')
    """
    if seconds < 48 * 3600.0:
        return f'{seconds / 3600.0:.3g} h'
    return (
        f'{seconds / 86400.0:.3g} days' if seconds < 3e7 else f'{seconds / 31557600.0:.3g} years'
    )


def _taken(stamp: IntArray, groups: list[FloatArray], order: IntArray) -> IntArray:
    """Reorder the groups in place, one after the other to save memory; return the stamps."""
    for k, group in enumerate(groups):
        groups[k] = group[order]
        del group
    return stamp[order]


def join_next(name: str, rows: IntArray, samples: Samples) -> Joined:
    """Give each sample to the row of its stamp, else to the next row at most one period later.

    Where several reach one row the newest stays. Rows without a sample hold NaN; `rows` (n,) are
    stamps [ns], the period is their median step.
    """
    values = samples.values[0]
    if np.array_equal(rows, samples.stamp):
        return Joined((values,))
    period = int(np.median(np.diff(rows))) if len(rows) > 1 else 0
    joined = np.full((len(rows), values.shape[1]), np.nan)
    used = 0
    for part in _blocks(len(samples.stamp)):
        moments = samples.stamp[part]
        row = np.searchsorted(rows, moments, side='left')
        reached = row < len(rows)
        reached &= rows[np.minimum(row, len(rows) - 1)] - moments <= period
        following = samples.stamp[part.stop : part.stop + 1]
        beyond = np.searchsorted(rows, following, side='left')
        last = np.diff(np.concatenate((row, beyond)), append=-1)[: len(row)] != 0
        reached &= last
        joined[row[reached]] = values[part][reached]
        used += int(np.count_nonzero(reached))
    lost = len(samples.stamp) - used
    return Joined((joined,), lost, _lost(name, lost, len(samples.stamp)))


def hold_newest(name: str, rows: IntArray, samples: Samples, *, event: bool = False) -> Joined:
    """Give each row the newest sample not later than itself, NaN (integers: −1) before the first.

    `event` marks tracks that are sent on change, whose silence at the end means nothing.
    """
    if np.array_equal(rows, samples.stamp):
        return Joined(samples.values)
    held: tuple[Any, ...] = tuple(
        np.empty((len(rows), v.shape[1]), v.dtype) for v in samples.values
    )
    for part in _blocks(len(rows)):
        newest = np.searchsorted(samples.stamp, rows[part], side='right') - 1
        for out, values in zip(held, samples.values, strict=True):
            out[part] = values[np.maximum(newest, 0)]
            out[part][newest < 0] = np.nan if out.dtype.kind == 'f' else -1
    if event:
        return Joined(held)
    total = len(samples.stamp)
    late = total - int(np.searchsorted(samples.stamp, rows[-1], side='right'))
    early = int(np.searchsorted(rows, samples.stamp[0], side='left'))
    notes = [*_lost(name, late, total)]
    if early > MOST_UNNOTED_SAMPLES:
        notes.append(f'{name}: {early} rows lie before its first sample')
    silence = (rows[-1] - samples.stamp[-1]) * 1e-9
    if silence > _allowed(samples.stamp):
        notes.append(f'{name} ends {silence:.0f} s before the last row, its last value is held')
    return Joined(held, late, tuple(notes))


def interpolate(rows: IntArray, samples: Samples) -> tuple[FloatArray, bool]:
    """Return the values (rows, k) between samples, and whether any row needed it.

    NaN before the first, after the last, and in gaps of more than LONGEST_BRIDGE_PERIODS periods.
    """
    values = np.asarray(samples.values[0], np.float64)
    if np.array_equal(rows, samples.stamp):
        return values, False
    found = np.stack(
        [np.interp(rows, samples.stamp, column, np.nan, np.nan) for column in values.T], axis=1
    )
    steps = np.diff(samples.stamp)
    if len(steps):
        after = np.clip(np.searchsorted(samples.stamp, rows, side='left'), 1, len(steps))
        found[steps[after - 1] > LONGEST_BRIDGE_PERIODS * np.median(steps)] = np.nan
    exact = np.isin(rows, samples.stamp)
    found[exact] = values[np.searchsorted(samples.stamp, rows[exact])]
    return found, not exact.all()


def _lost(name: str, lost: int, total: int) -> tuple[str, ...]:
    return (
        (f'{name}: {lost} of {total} samples found no row',) if lost > MOST_UNNOTED_SAMPLES else ()
    )


def _blocks(length: int) -> Iterator[slice]:
    """Cut a length into blocks, so that intermediate results stay small."""
    for at in range(0, length, ROWS_PER_BLOCK):
        yield slice(at, min(at + ROWS_PER_BLOCK, length))


def _allowed(stamp: IntArray) -> float:
    step = float(np.median(np.diff(stamp))) * 1e-9 if len(stamp) > 1 else 0.0
    return max(STALE_TRACK_S, 10.0 * step)
