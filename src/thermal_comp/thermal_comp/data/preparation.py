# SPDX-License-Identifier: Apache-2.0
"""From recordings to what is fitted: runs as block means, true inputs, parts to hold out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from imu_recording.logging_contract import CHANNEL_FIELDS, TEMPERATURE_TOPIC
from imu_recording.phase import cycles_from_temperature, phases_from_setpoint
from imu_recording.recording import (
    SENSOR_FIELDS,
    FloatArray,
    ImuRecording,
    IntArray,
    RecordingError,
    columns_hash,
)
from imu_recording.synchronise import longest_stretch

from thermal_comp.data.binning import bin_means, bin_variances
from thermal_comp.data.conditions import (
    PER_RUN,
    SENSORS,
    Conditions,
    Sensor,
    mounting_rotation,
    static_conditions,
)
from thermal_comp.data.gaps import MEMORY_S, decays_after_gaps
from thermal_comp.data.hard_iron import hard_iron_of
from thermal_comp.data.quality import without_damage
from thermal_comp.data.smoothing import smoothed_conditions
from thermal_comp.data.startup import cut_startup
from thermal_comp.effects.effect import Effect


@dataclass(frozen=True, eq=False)
class PreparedRun:
    """One run as fits and diagnosis see it: m block means, conditions on a finer grid.

    Effects are evaluated on the fine rows (history, squares) and then averaged over the blocks.
    """

    name: str
    device: str
    conditions: Conditions
    """Fine rows; temperature and every present channel are finite."""
    starts: IntArray
    """(m, 2) first fine row of each block and the first one after it."""
    slot: IntArray
    """(m,) place of each block on the uniform grid of `period`; a gap is a missing place."""
    period: float
    """[s]."""
    measured: Mapping[Sensor, FloatArray]
    """(m, 3) block means per sensor, NaN where a block has no valid sample."""
    fine_measured: Mapping[Sensor, FloatArray]
    """(n, 3) what was measured at the fine rows, per sensor; NaN where missing."""
    cv_group: IntArray
    """(m,) part of the run that is held out together, 1 …; 0 is never held out."""
    has_cycles: bool
    """Whether the parts are thermal cycles; else they are contiguous blocks."""
    origin: int = 0
    """Stamp at which its time is zero [ns]."""
    sampled: bool = False
    """Whether the fine rows are samples, whose stamps may jitter, and not means."""
    hash: str = ''
    """SHA-256 of the columns it was prepared from."""
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.slot)

    def block_mean(self, values: FloatArray) -> FloatArray:
        """Return the (m, …) means of (n, …) fine rows over the blocks."""
        edges = self.starts.ravel()
        rows = edges[1::2] - edges[::2]
        total = np.add.reduceat(values[: edges[-1]], edges[:-1], axis=0)[::2]
        mean: FloatArray = total / rows.reshape(-1, *[1] * (values.ndim - 1))
        return mean

    def columns(self, effect: Effect, sensor: Sensor) -> FloatArray:
        """Return the effect's (m, p) or (m, 3, p) columns, averaged over the blocks."""
        return self.block_mean(effect.columns(self.conditions.of(sensor))[0])

    @cached_property
    def smoothed(self) -> PreparedRun:
        """The run without the noise of its thermometer, for what learns from the whole of it.

        Columns of a noisy temperature pull their coefficients towards zero (regression dilution;
        Carroll et al., Measurement Error in Nonlinear Models, 2006, ch. 4: regression
        calibration), the more the slower the temperature moves.
        """
        return replace(self, conditions=smoothed_conditions(self.conditions))

    @cached_property
    def time(self) -> FloatArray:
        """(m,) mean time of each block since the first sample of the run [s]."""
        return self.block_mean(self.conditions.time)

    @cached_property
    def temperature(self) -> FloatArray:
        """(m,) mean die temperature of each block [°C]."""
        return self.block_mean(self.conditions.temperature)

    @cached_property
    def after_gaps(self) -> FloatArray:
        """(m, q) decays after gaps, of what temperatures that nobody measured left behind.

        Each lives in one part that is held out: its tail beyond says nothing of its size.
        """
        decays = self.block_mean(decays_after_gaps(self.conditions.time))
        parts = [decays * (self.cv_group == k)[:, None] for k in np.unique(self.cv_group)]
        columns = np.concatenate([np.zeros((len(self), 0)), *parts], axis=1)
        return columns[:, columns.any(axis=0)]

    @cached_property
    def vibration(self) -> FloatArray | None:
        """(m,) variance of the acceleration within each block, summed over the axes [(m/s²)²]."""
        vibration = self.conditions.vibration
        return None if vibration is None else self.block_mean(vibration).sum(axis=1)

    @cached_property
    def phase(self) -> IntArray:
        """(m,) index into PHASES in the middle of each block; −1 unknown."""
        return self._middle(self.conditions.phase, -1)

    @cached_property
    def cycle(self) -> IntArray:
        """(m,) thermal cycle in the middle of each block; 0 outside the cycles."""
        return self._middle(self.conditions.cycle, 0)

    @cached_property
    def block_conditions(self) -> Conditions:
        """Conditions as block means."""
        taken: dict[str, Any] = {
            item.name: self.block_mean(value)
            for item in fields(self.conditions)
            if isinstance(value := getattr(self.conditions, item.name), np.ndarray)
            and item.name not in (*PER_RUN, 'phase', 'cycle')
        }
        return replace(self.conditions, phase=self.phase, cycle=self.cycle, **taken)

    def _middle(self, values: IntArray | None, unknown: int) -> IntArray:
        if values is None:
            return np.full(len(self.slot), unknown, dtype=np.int64)
        middle: IntArray = values[(self.starts[:, 0] + self.starts[:, 1] - 1) // 2]
        return middle


__all__ = ['PreparedRun', 'contiguous_parts', 'prepare', 'prepare_run', 'resting']

PERIODS = (20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)
"""Lengths of blocks [s]; errors are quoted on means over a block."""
BLOCKS = 400
"""Blocks a run has at least, while its samples allow it."""
GAP_STEPS = 10.0
"""A pause longer than so many usual intervals …"""
GAP_S = 5.0
"""… and than this is a gap, in which nothing was sampled [s]: serial lines pause for seconds."""
MOST_SLOTS = 100_000
"""Places of blocks a run has at most, those in gaps included."""
FINE_PERIOD = 1.0
"""Columns are evaluated on means over this [s], or on the samples where they are slower."""
VIBRATION_RATE = 50.0
"""Slowest sample rate [Hz] from which vibration is computed."""
RATE_TOLERANCE = 1.02
"""How much further apart samples of that rate may be: stamps jitter, and clocks err."""
FEWEST_PARTS, MOST_PARTS = 5, 12
"""Contiguous parts a run without cycles is cut into, to be held out one at a time: what a term
gains on five of them is seldom more than chance, …"""
PART_BLOCKS = 10
"""… and a part of fewer blocks tells little."""
FEWEST_CYCLE_ROWS = 10
"""Rows of a cycle on average, below which its two ends are not left out."""
LEADING_GAP_S = 60.0
"""A track that starts at most this much after the IMU takes its first value until then [s]."""

Truth = Callable[[ImuRecording], Conditions]
"""How the true inputs of a run follow from its recording."""


def prepare(
    recordings: Sequence[ImuRecording], *, period: float | None = None, truth: Truth | None = None
) -> list[PreparedRun]:
    """Return one prepared run per recording, start-up transients cut, gaps left out.

    `period` is the length of the blocks [s], 0 for the full rate; None: the longest run's
    `block_length`. `truth` gives the true inputs; None means a device at rest: gravity along
    `up_axis`, no rotation, the run's mean field.
    """
    names: dict[str, int] = {}
    runs = [
        prepare_run(
            recording,
            run_name(recording, number, names),
            period=period,
            truth=truth or resting,
        )
        for number, recording in enumerate(recordings, 1)
    ]
    return as_campaign(in_common_blocks(runs) if period is None else runs)


def as_campaign(runs: Sequence[PreparedRun]) -> list[PreparedRun]:
    """Return runs of one device in one field, with what they know of each other.

    That is the time since the first of them began, and what all tell of the hard iron.
    """
    offset = hard_iron_of([run.conditions for run in runs])
    first = min((run.origin for run in runs), default=0)
    return [
        replace(
            run,
            conditions=replace(
                run.conditions, hard_iron=offset, time_before=(run.origin - first) * 1e-9
            ),
        )
        for run in runs
    ]


def run_name(recording: ImuRecording, number: int, taken: dict[str, int]) -> str:
    """Return a name for the run that is not taken; counts it as taken."""
    name = recording.run or recording.source.rstrip('/').rpartition('/')[2] or str(number)
    taken[name] = taken.get(name, 0) + 1
    return name if taken[name] == 1 else f'{name} ({taken[name]})'


def resting(recording: ImuRecording) -> Conditions:
    """Return the conditions of a device at rest, mounted as its up axis tells."""
    rotation = mounting_rotation(recording.up_axis) if recording.up_axis else None
    return static_conditions(recording, orientation=rotation)


def prepare_run(
    recording: ImuRecording, name: str, *, period: float | None = None, truth: Truth = resting
) -> PreparedRun:
    """Return the prepared run of one recording."""
    if len(recording) < 2:
        raise RecordingError(f'{name}: {len(recording)} rows are too few for a run')
    stretch, jumped = longest_stretch('samples', recording.stamp)
    whole = recording.rows(stretch).with_notes(jumped) if jumped else recording
    recording = cut_startup(whole)
    notes = list(recording.notes)
    if truth is resting:  # what moves may well leave its neighbours for one sample
        recording, damaged = without_damage(recording)
        notes += damaged
    recording = _measured_temperature(recording)
    origin = int(whole.stamp[0])
    period = block_length(recording) if period is None else period
    fine, counted = _fine(recording, origin, min(period, FINE_PERIOD))
    sampled = len(fine) == len(recording)
    notes += counted
    known = np.isfinite(fine.temperature)
    fine = fine.rows(known)
    if not len(fine):
        absent = f'no topic {TEMPERATURE_TOPIC}'
        found = next((f'; {note}' for note in notes if note.startswith(absent)), '')
        raise RecordingError(
            f'{name}: no sample has a die temperature (topic {TEMPERATURE_TOPIC}){found}'
        )
    fine, filled = _complete(fine)
    notes += filled
    fine = _without_cycle_ends(fine)
    offset = (fine.stamp[0] - origin) * 1e-9
    conditions = truth(fine)
    conditions = replace(conditions, time=conditions.time + offset)
    run = in_blocks(
        PreparedRun(
            name=name,
            device=recording.device,
            conditions=conditions,
            starts=np.zeros((0, 2), dtype=np.int64),
            slot=np.zeros(0, dtype=np.int64),
            period=period,
            measured={},
            fine_measured={s: _finite_or_nan(getattr(fine, SENSOR_FIELDS[s])) for s in SENSORS},
            cv_group=np.zeros(0, dtype=np.int64),
            has_cycles=False,
            origin=origin,
            sampled=sampled,
            hash=columns_hash(whole),
        ),
        period,
    )
    if 0 < period < run.period:
        notes.append(
            f'samples are {run.period:g} s apart: errors are on single samples, not on means'
        )
    holes = int(run.slot[-1] - run.slot[0] + 1 - len(run)) if len(run) else 0
    if holes:
        notes.append(
            f'{holes * run.period:.0f} s in gaps, half-empty blocks or where cycles meet left out'
        )
    if gaps := decays_after_gaps(run.conditions.time).shape[1] // len(MEMORY_S):
        notes.append(
            f'{gaps} long {"gap" if gaps == 1 else "gaps"}: what the temperatures of '
            f'{"it" if gaps == 1 else "them"} left behind is unknown, and fitted beside the level'
        )
    if not run.has_cycles:
        count = int(run.cv_group.max(initial=0))
        notes.append(f'no thermal cycles: held out are {count} contiguous blocks of the run')
    return replace(run, notes=tuple(f'{name}: {note}' for note in notes))


def in_common_blocks(runs: Sequence[PreparedRun]) -> list[PreparedRun]:
    """Return the runs in blocks of one length, the longest that any of them has."""
    longest = max((run.period for run in runs), default=0.0)
    return [run if run.period == longest else in_blocks(run, longest) for run in runs]


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


def block_length(recording: ImuRecording) -> float:
    """Return the length of a recording's blocks [s]: so that there are BLOCKS, if that may be.

    Two hours and more have blocks of 20 s, 20 min of 2 s, a burst of 86 s of 0.2 s. What counts
    is the time that was sampled: bursts an hour apart have the blocks of a burst.
    """
    intervals = np.diff(recording.stamp) * 1e-9
    longest = max(GAP_STEPS * float(np.median(intervals)), GAP_S)
    sampled = float(np.minimum(intervals, longest).sum())
    fitting = (length for length in PERIODS if length * BLOCKS <= sampled)
    length = next(fitting, PERIODS[-1])
    slots = float(intervals.sum()) / MOST_SLOTS
    return next((longer for longer in PERIODS[::-1] if longer >= max(length, slots)), PERIODS[0])


def _fine(recording: ImuRecording, origin: int, period: float) -> tuple[ImuRecording, list[str]]:
    """Return the recording as means over `period` [s], or as it is where it is slower.

    The bins start at `origin` [ns], whatever was cut. Where samples begin or end within a bin, in
    less than a quarter of it, there is none: its noise would be twice the others'.
    """
    notes = _bad_rows(recording)
    step = float(np.median(np.diff(recording.stamp))) * 1e-9
    if step > 0.75 * period:
        return recording, notes
    length = round(period * 1e9)
    bins = (recording.stamp - origin) // length
    starts = np.flatnonzero(np.diff(bins, prepend=bins[0] - 1))
    edges = np.append(starts, len(bins)).astype(np.int64)
    middle = (edges[:-1] + edges[1:] - 1) // 2
    taken: dict[str, Any] = {}
    for item in fields(recording):
        column = getattr(recording, item.name)
        if isinstance(column, np.ndarray) and item.name != 'stamp':
            exact = column.dtype.kind == 'i' or item.name == 'reference_orientation'
            taken[item.name] = column[middle] if exact else bin_means(column, edges)[0]
    if recording.vibration is None and step <= RATE_TOLERANCE / VIBRATION_RATE:
        taken['vibration'] = bin_variances(
            recording.linear_acceleration, edges, taken['linear_acceleration']
        )
    stamp = origin + ((2 * bins[starts] + 1) * length) // 2
    rows, distance = np.diff(edges), np.diff(bins[starts])
    inside = (np.append(distance, 2) == 1) & (np.insert(distance, 0, 2) == 1)
    whole = inside | (rows >= 0.25 * np.median(rows))
    return replace(recording, stamp=stamp, **taken).rows(whole), notes


def _finite_or_nan(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)


def _bad_rows(recording: ImuRecording) -> list[str]:
    notes = []
    for sensor, name in SENSOR_FIELDS.items():
        values = getattr(recording, name)
        # One value that is not finite makes the sum so.
        finite = np.isfinite(values.sum())
        bad = 0 if finite else int((~np.isfinite(values).all(axis=1)).sum())
        if bad == len(recording):
            notes.append(f'no {sensor} value')
        elif bad:
            notes.append(f'{bad} of {len(recording)} rows without a finite {sensor} value')
    bad = int((~np.isfinite(recording.temperature)).sum())
    if bad:
        notes.append(f'{bad} of {len(recording)} rows without a die temperature left out')
    return notes


def _complete(fine: ImuRecording) -> tuple[ImuRecording, list[str]]:
    """Fill short gaps of the other tracks with the newest value; drop tracks that start late."""
    changed: dict[str, Any] = {}
    notes = []
    for name in CHANNEL_FIELDS:
        column = getattr(fine, name)
        if column is None:
            continue
        finite = np.isfinite(column).reshape(len(column), -1).all(axis=1)
        if not finite.any():
            changed[name] = None
        elif not finite.all():
            lead = (fine.stamp[int(np.argmax(finite))] - fine.stamp[0]) * 1e-9
            if lead > LEADING_GAP_S or not finite.mean() > 0.5:
                changed[name] = None
                notes.append(f'{name} is known in {finite.mean():.0%} of the run only: not used')
            else:
                row = np.maximum.accumulate(np.where(finite, np.arange(len(column)), 0))
                changed[name] = column[np.maximum(row, np.argmax(finite))]
    setpoint = changed.get('setpoint', fine.setpoint)
    if fine.cycle is None and setpoint is not None:
        changed['phase'], changed['cycle'] = phases_from_setpoint(fine.time, setpoint)
    cycle = changed.get('cycle', fine.cycle)
    if cycle is None or not cycle.any():
        cycle = cycles_from_temperature(fine.time, fine.temperature)
        if cycle.any():
            changed['cycle'] = cycle
            notes.append(f'{cycle.max()} thermal cycles are found in the temperature itself')
    return replace(fine, **changed), notes


def _without_cycle_ends(fine: ImuRecording) -> ImuRecording:
    """Return the recording without the rows on both sides of where a cycle ends.

    A row may hold a share of both cycles, whatever its label says: where each has a level of its
    own, an error of many times the noise. Labels that change with nearly every row are no cycles.
    """
    if fine.cycle is None:
        return fine
    ends = np.flatnonzero(np.diff(fine.cycle))
    if len(ends) * FEWEST_CYCLE_ROWS > len(fine):
        return fine
    kept = np.ones(len(fine), dtype=bool)
    kept[ends] = kept[ends + 1] = False
    return fine.rows(kept)


def _measured_temperature(recording: ImuRecording) -> ImuRecording:
    """Return the recording with the die temperature between its samples interpolated.

    Rows hold the newest sample; a device that warms is ahead of it by half an interval on
    average, which looks like an effect of the temperature's rate.
    """
    if recording.temperature_stamp is None:
        return recording
    known = np.isfinite(recording.temperature) & (recording.temperature_stamp >= 0)
    stamp, first = np.unique(recording.temperature_stamp[known], return_index=True)
    if len(stamp) < 2:
        return recording
    values = recording.temperature[known][first]
    between = np.interp(recording.stamp - stamp[0], stamp - stamp[0], values)
    between[~known] = np.nan
    return replace(recording, temperature=between, temperature_stamp=None)


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
    parts = min(max(FEWEST_PARTS, min(MOST_PARTS, blocks // PART_BLOCKS)), blocks)
    part: IntArray = 1 + np.arange(blocks, dtype=np.int64) * parts // max(blocks, 1)
    return part


def _block_measurement(run: PreparedRun, sensor: Sensor) -> FloatArray:
    """Return the (m, 3) means of the rows that are finite; blocks less than half full are NaN."""
    mean, count = bin_means(run.fine_measured[sensor], run.starts.ravel())
    mean, count = mean[::2], count[::2]
    if count.any():
        mean[count < 0.5 * np.median(count[count > 0])] = np.nan
    return mean
