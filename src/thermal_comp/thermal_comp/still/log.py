# SPDX-License-Identifier: Apache-2.0
"""One log of a device that moves: its stretches at rest as runs, with the log's own history."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording, columns_hash
from imu_recording.synchronise import longest_stretch

from thermal_comp.data.conditions import Conditions, field_conditions
from thermal_comp.data.preparation import prepare_run
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.still.rest import LEAST_REST_S, find_rest

PERIOD_S = 2.0
"""Length of a block [s]."""
LEAST_BLOCKS = 6
"""Blocks of a stretch, at least."""
FIRST_DATE_NS = 10**18
"""Stamps from here on (2001) are dates; smaller ones count from power-on."""


@dataclass(frozen=True, eq=False)
class RestingLog:
    """The stretches at rest of one power-on, as runs without a pose."""

    name: str
    runs: Sequence[PreparedRun]
    """Blocks of one stretch each; conditions and time are those of the whole log."""
    seconds: float
    """Length of the log [s]."""
    rest: Sequence[tuple[float, float]]
    """Start and end of each stretch since the first sample [s]."""
    started: float | None = None
    """Unix time of its start [s]; None where unknown."""
    note: str = ''
    """Why it has no stretch at rest, or what was left out of it."""


def resting_log(
    recording: ImuRecording,
    name: str = '',
    *,
    started: float | None = None,
    least_s: float = LEAST_REST_S,
) -> tuple[RestingLog, list[ImuRecording]]:
    """Return the log's stretches at rest as runs, and as recordings of their own.

    A stretch is named after the log and its number: flight#1, flight#2 … The temperature before it
    in the log, in motion as well, is part of its history: a lag follows it.
    """
    name = name or recording.run or recording.source.rstrip('/').rpartition('/')[2] or 'log'
    whole, jumped = longest_stretch('samples', recording.stamp)
    recording = recording.rows(whole).with_notes(jumped) if jumped else recording
    rest = find_rest(recording, least_s=least_s)
    if started is None and len(recording) and recording.stamp[0] >= FIRST_DATE_NS:
        started = float(recording.stamp[0]) * 1e-9
    runs, parts, times = [], [], []
    log = None
    if rest.stretches:
        log = prepare_run(recording, name, period=PERIOD_S, truth=in_unknown_pose)
    for number, rows in enumerate(rest.stretches, 1):
        part = replace(recording.rows(rows), run=f'{name}#{number}', up_axis='')
        ends = (recording.stamp[[rows.start, rows.stop - 1]] - recording.stamp[0]) * 1e-9
        run = None if log is None else _stretch(log, part, float(ends[0]), float(ends[1]))
        if run is not None:
            runs.append(run)
            parts.append(part)
            times.append((float(ends[0]), float(ends[1])))
    seconds = float(recording.time[-1]) if len(recording) else 0.0
    notes = '; '.join(filter(None, (jumped, rest.note)))
    log_at_rest = RestingLog(
        name=name, runs=runs, seconds=seconds, rest=times, started=started, note=notes
    )
    return log_at_rest, parts


def _stretch(log: PreparedRun, part: ImuRecording, start: float, end: float) -> PreparedRun | None:
    """Return the blocks within a stretch; None where there are too few."""
    time = log.conditions.time
    first, last = time[log.starts[:, 0]], time[log.starts[:, 1] - 1]
    half = 0.5 * min(1.0, log.period)
    inside = (first - half >= start) & (last + half <= end)
    if inside.sum() < LEAST_BLOCKS:
        return None
    slot = log.slot[inside]
    return replace(
        log,
        name=part.run,
        starts=log.starts[inside],
        slot=slot - slot[0],
        measured={sensor: values[inside] for sensor, values in log.measured.items()},
        cv_group=np.ones(len(slot), np.int64),
        hash=columns_hash(part),
    )


def in_unknown_pose(recording: ImuRecording) -> Conditions:
    """Return the conditions of a device whose pose is not known: no rotation, gravity as measured.

    The (n, 3) specific force is the measured one, which a stretch at rest has about constant.
    """
    rate: FloatArray = np.zeros((len(recording), 3))
    return replace(field_conditions(recording), angular_velocity=rate)
