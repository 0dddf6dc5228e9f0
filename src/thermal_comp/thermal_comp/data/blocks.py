# SPDX-License-Identifier: Apache-2.0
"""Cutting runs into blocks: their length, the rows of each, the parts that are held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording, IntArray

from thermal_comp.data.binning import bin_means
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.spectral_lines import SpectralLine

BLOCK_LENGTHS_S = (20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)
"""Lengths a block may have [s]; errors are quoted on means over a block."""
LEAST_BLOCKS = 400
"""Blocks a run is to have at least, where its samples allow it."""
LONGEST_PAUSE_STEPS = 10.0
"""Longest pause that counts as sampled time, in usual intervals; or LONGEST_PAUSE_S, whichever is
more."""
LONGEST_PAUSE_S = 5.0
"""Longest pause that always counts as sampled time [s]: serial lines pause for seconds."""
MOST_SLOTS = 100_000
"""Largest number of places of blocks in a run, those in gaps included."""
LEAST_PARTS, MOST_PARTS = 5, 12
"""Least and greatest number of contiguous parts of a run without cycles, which are held out one at
a time. More parts tell more surely whether a term lowers the error."""
LEAST_PART_BLOCKS = 10
"""Least number of blocks of such a part."""
LEAST_SEARCH_BLOCKS = 700
"""Least number of blocks of the longest run in a search of long runs."""
LONGEST_SEARCH_BLOCK_S = 60.0
"""Greatest length of such blocks [s]: lags of half a minute still show in ramps."""
BLOCKS_PER_PERIOD = 8
"""Least number of such blocks per period of a spectral line: means keep 97 % of its amplitude."""


def block_length(recording: ImuRecording) -> float:
    """Return the greatest length [s] that gives a recording LEAST_BLOCKS blocks, if any does.

    2¼ hours and more have blocks of 20 s, 20 min of 2 s, a burst of 86 s of 0.2 s. What counts
    is the time that was sampled: bursts an hour apart have the blocks of a burst.
    """
    intervals = np.diff(recording.stamp) * 1e-9
    longest = max(LONGEST_PAUSE_STEPS * float(np.median(intervals)), LONGEST_PAUSE_S)
    sampled = float(np.minimum(intervals, longest).sum())
    fitting = (length for length in BLOCK_LENGTHS_S if length * LEAST_BLOCKS <= sampled)
    length = next(fitting, BLOCK_LENGTHS_S[-1])
    slots = float(intervals.sum()) / MOST_SLOTS
    return next(
        (longer for longer in BLOCK_LENGTHS_S[::-1] if longer >= max(length, slots)),
        BLOCK_LENGTHS_S[0],
    )


def in_blocks(run: PreparedRun, period: float) -> PreparedRun:
    """Return the run in blocks of another length [s]; that of its rows where they are longer."""
    time = run.conditions.time
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    length = max(period, step)
    starts, slot = _blocks(time, length, step, sampled=run.sampled)
    cv_group, has_cycles = _cv_groups(run.conditions.cycle, starts)
    new = replace(
        run, starts=starts, slot=slot, period=length, cv_group=cv_group, has_cycles=has_cycles
    )
    return replace(new, measured={s: _block_measurement(new, s) for s in new.fine_measured})


def in_common_blocks(runs: Sequence[PreparedRun]) -> list[PreparedRun]:
    """Return the runs in blocks of one length, the longest that any of them has."""
    longest = max((run.period for run in runs), default=0.0)
    return [run if run.period == longest else in_blocks(run, longest) for run in runs]


def in_search_blocks(
    runs: Sequence[PreparedRun], lines: Sequence[SpectralLine]
) -> list[PreparedRun]:
    """Return long runs in longer blocks: less work, and slow effects look the same.

    A spectral line would be averaged away in blocks that are not short against its period.
    """
    blocks = max(len(run) for run in runs)
    warmest = max(float(np.abs(run.conditions.temperature_difference).max()) for run in runs)
    fastest = max((abs(f) + abs(drift) * warmest for f, drift in lines), default=0.0)
    longest = min(LONGEST_SEARCH_BLOCK_S, 1.0 / (BLOCKS_PER_PERIOD * max(fastest, 1e-9)))
    factor = min(blocks // LEAST_SEARCH_BLOCKS, int(longest / runs[0].period))
    if factor < 2:
        return list(runs)
    return [in_blocks(run, factor * run.period) for run in runs]


def _blocks(
    time: FloatArray, period: float, step: float, *, sampled: bool
) -> tuple[IntArray, IntArray]:
    """Return the (m, 2) fine rows of each block that is at least half full, and its slot.

    `sampled`: rows are samples, whose stamps may jitter about a block's edge, not means.
    """
    early = 0.5 * step if sampled else 0.0
    place = np.floor((time + early) / period + 1e-9).astype(np.int64)
    first = np.flatnonzero(np.diff(place, prepend=place[0] - 1))
    after = np.append(first[1:], len(place))
    rows = after - first
    full = rows >= 0.5 * np.median(rows)
    starts = np.column_stack([first, after]).astype(np.int64)
    return starts[full], place[first][full]


def _cv_groups(cycle: IntArray | None, starts: IntArray) -> tuple[IntArray, bool]:
    """Return the part each block belongs to, and whether the parts are thermal cycles."""
    m = len(starts)
    if cycle is not None:
        cv_group = np.maximum(cycle[(starts[:, 0] + starts[:, 1] - 1) // 2], 0)
        if len(np.unique(cv_group[cv_group > 0])) >= 2:
            return cv_group, True
    return contiguous_parts(m), False


def contiguous_parts(blocks: int) -> IntArray:
    """Return (blocks,) the part, from 1, of each block of a run without cycles to hold out."""
    parts = min(max(LEAST_PARTS, min(MOST_PARTS, blocks // LEAST_PART_BLOCKS)), blocks)
    part: IntArray = 1 + np.arange(blocks, dtype=np.int64) * parts // max(blocks, 1)
    return part


def _block_measurement(run: PreparedRun, sensor: Sensor) -> FloatArray:
    """Return the (m, 3) means of the rows that are finite; blocks less than half full are NaN."""
    mean, count = bin_means(run.fine_measured[sensor], run.starts.ravel())
    mean, count = mean[::2], count[::2]
    if count.any():
        mean[count < 0.5 * np.median(count[count > 0])] = np.nan
    return mean
