# SPDX-License-Identifier: Apache-2.0
"""Times of measurement of a temperature that was written more often than it was measured.

A board that reads its thermometer once a second and writes the value into every row of 100 Hz
stamps it half a second late on average, which looks like an effect of the rate of change.
"""

from __future__ import annotations

import numpy as np

from imu_recording.recording import FloatArray, IntArray

LEAST_CHANGES = 30
"""Changes of the value from which its period is estimated."""
LEAST_ROWS_PER_MEASUREMENT = 3
"""Rows per measurement from which repetition matters."""
ON_TIME_SHARE = 0.95
"""Least share of the changes that come on time: whole periods after the one before, to one row, or
to two where the period is long."""
LONG_PERIOD_ROWS = 20.0
"""Rows in a period from which it is long."""
LONG_INTERVALS = 10
"""Least number of intervals of two periods and more, on time, that show a period and no slow,
coarse sensor."""
CHANCE_PROBABILITY = 0.5
"""Largest probability of being on time by chance with which a period is known."""
UNEVEN_STEP_RATIO = 1.5
"""Ratio to the smallest step from which steps differ in size: those of a resolution are equal."""


def measurement_stamps(written: IntArray, values: FloatArray) -> IntArray | None:
    """Return (n,) when the value of each row was measured [ns], −1 where it is NaN.

    None where each value may have been measured when it was written. `written`: (n,) stamps of
    the rows [ns], increasing, repeated where the same value is given again. The rule: the value
    changes only whole periods after it changed before. A coarse resolution on a slow ramp looks
    alike; then the steps are of one size and no interval is several periods long.

    >>> rows = np.arange(400) * 10
    >>> held = np.repeat(np.sin(np.arange(40.0)), 10)
    >>> measurement_stamps(rows, held)[:22].tolist()[::7]
    [0, 0, 100, 200]
    >>> measurement_stamps(rows, np.sin(np.arange(400.0))) is None
    True
    """
    with np.errstate(invalid='ignore'):  # ∞ − ∞
        moves = np.abs(np.diff(values)) > 0.0  # False beside NaN: at least as many are changes
    if np.count_nonzero(moves) * (LEAST_ROWS_PER_MEASUREMENT - 1) > len(values):
        return None
    known = np.flatnonzero(np.isfinite(values) & (written >= 0))
    first = known[np.flatnonzero(np.diff(written[known], prepend=-1))]
    changed = np.flatnonzero(np.diff(values[first])) + 1
    if len(changed) < LEAST_CHANGES or len(changed) * (LEAST_ROWS_PER_MEASUREMENT - 1) > len(
        first
    ):
        return None
    rows_between = np.diff(changed)
    period = _period(rows_between, np.abs(np.diff(values[first])[changed - 1]))
    if not period:
        return None
    edges = np.concatenate(([0], changed, [len(first)]))
    length = np.diff(edges)
    count = np.maximum(np.rint(length / period), 1.0)
    since = np.arange(len(first)) - np.repeat(edges[:-1], length)
    each = np.repeat(length / count, length)
    newest = np.repeat(edges[:-1], length) + np.floor(np.floor(since / each) * each).astype(int)
    of_first = written[first][newest]
    stamps = np.full(len(values), -1, np.int64)
    stamps[known] = of_first[np.searchsorted(written[first], written[known])]
    return stamps


def note_held(written: IntArray, values: FloatArray, notes: list[str]) -> IntArray | None:
    """Return `measurement_stamps`, and note how often a temperature was measured."""
    stamps = measurement_stamps(written, values)
    if stamps is not None:
        measured = np.unique(stamps[stamps >= 0])
        every = 1e-9 * float(np.median(np.diff(measured)))
        notes.append(f'temperature: measured every {every:.3g} s and repeated between')
    return stamps


def _period(rows_between: IntArray, steps: FloatArray) -> float:
    """Return the number of rows per measurement, 0 where the changes (k,) have no period."""
    period = float(np.median(rows_between[rows_between < 1.5 * np.quantile(rows_between, 0.1)]))
    for _ in range(3):  # longer intervals determine it better
        count = np.maximum(np.rint(rows_between / period), 1.0)
        near = count <= 10.0
        period = float(rows_between[near].sum() / count[near].sum())
    if period < LEAST_ROWS_PER_MEASUREMENT:
        return 0.0
    count = np.maximum(np.rint(rows_between / period), 1.0)
    tolerance = 1.5 if period < LONG_PERIOD_ROWS else 2.5
    on_time = np.abs(rows_between - count * period) <= tolerance
    if on_time.mean() < ON_TIME_SHARE:
        return 0.0
    least = float(steps.min())
    if float(np.mean(steps > UNEVEN_STEP_RATIO * least)) > 1.0 - ON_TIME_SHARE:
        return period
    longer = (count > 1.0) & (count <= 10.0)
    is_significant = (
        period > 2.0 * tolerance / CHANCE_PROBABILITY and int(longer.sum()) >= LONG_INTERVALS
    )
    return period if is_significant and on_time[longer].mean() >= ON_TIME_SHARE else 0.0
