# SPDX-License-Identifier: Apache-2.0
"""From recordings to the runs that are fitted: of one recording, and of a whole campaign."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from imu_recording.logging_contract import TEMPERATURE_TOPIC
from imu_recording.recording import (
    SENSOR_FIELDS,
    FloatArray,
    ImuRecording,
    RecordingError,
    columns_hash,
)
from imu_recording.synchronise import longest_stretch

from thermal_comp.data.blocks import block_length, in_blocks, in_common_blocks
from thermal_comp.data.conditions import (
    SENSORS,
    Conditions,
    mounting_rotation,
    static_conditions,
)
from thermal_comp.data.fine_rows import (
    FINE_PERIOD_S,
    complete,
    fine_rows,
    measured_temperature,
    measurement_interval,
    with_measurement_stamps,
    without_cycle_ends,
)
from thermal_comp.data.gaps import ends_of_long_gaps
from thermal_comp.data.headings import hard_iron_of, turned_orientations
from thermal_comp.data.parts_at_rest import all_parts_at_rest
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.quality import without_damage
from thermal_comp.data.rounding import Rounding
from thermal_comp.data.startup import cut_startup
from thermal_comp.data.thermometer_counts import counts_of

Truth = Callable[[ImuRecording], Conditions]
"""How the true inputs of a run follow from its recording."""

HEADINGS_FOUND = (
    'the mean magnetic fields say how the device was turned about the vertical from run to run: '
    'by right angles other than those of the usual fixture'
)
"""Note on the first run of a campaign."""


def prepare(
    recordings: Sequence[ImuRecording], *, period: float | None = None, truth: Truth | None = None
) -> list[PreparedRun]:
    """Return one prepared run per recording, start-up transients cut, gaps left out.

    A recording of a device at rest that was moved or turned for a while is one run per part.

    `period` is the length of the blocks [s], 0 for the full rate; None: the longest run's
    `block_length`. `truth` gives the true inputs; None means a device at rest: gravity along
    `up_axis`, no rotation, the run's mean field.
    """
    names: dict[str, int] = {}
    if truth is None:
        recordings = all_parts_at_rest(recordings)
    runs = [
        prepare_run(
            recording,
            run_name(recording, number, names),
            period=period,
            truth=truth or resting_conditions,
        )
        for number, recording in enumerate(recordings, 1)
    ]
    return as_campaign(in_common_blocks(runs) if period is None else runs)


def as_campaign(runs: Sequence[PreparedRun]) -> list[PreparedRun]:
    """Return runs of one device in one field, with what only all of them together tell.

    That is the time since the first of them began, the headings and the hard iron.
    """
    turned = turned_orientations([run.conditions for run in runs])
    if turned is not None:
        runs = [
            replace(run, conditions=replace(run.conditions, orientation=orientation))
            for run, orientation in zip(runs, turned, strict=True)
        ]
        runs[0] = replace(runs[0], notes=(*runs[0].notes, HEADINGS_FOUND))
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
    """Return a name for the run that is not in `taken`, and count it there."""
    name = recording.run or recording.source.rstrip('/').rpartition('/')[2] or str(number)
    taken[name] = taken.get(name, 0) + 1
    return name if taken[name] == 1 else f'{name} ({taken[name]})'


def resting_conditions(recording: ImuRecording) -> Conditions:
    """Return the conditions of a device at rest, its up axis up."""
    rotation = mounting_rotation(recording.up_axis) if recording.up_axis else None
    return static_conditions(recording, orientation=rotation)


def prepare_run(
    recording: ImuRecording,
    name: str,
    *,
    period: float | None = None,
    truth: Truth = resting_conditions,
) -> PreparedRun:
    """Return the prepared run of one recording."""
    whole, held = with_measurement_stamps(_longest_stretch(recording, name))
    started = cut_startup(whole)
    notes = [*held, *started.notes]
    if truth is resting_conditions:  # in motion a single row may truly differ from its neighbours
        started, damaged = without_damage(started)
        notes += damaged
    measured = measured_temperature(started)
    origin = int(whole.stamp[0])
    period = block_length(measured) if period is None else period
    fine, counted = fine_rows(measured, origin, min(period, FINE_PERIOD_S))
    sampled = len(fine) == len(measured)
    fine, filled = complete(_with_known_temperature(fine, name, notes))
    notes += [*counted, *filled]
    fine = without_cycle_ends(fine)
    conditions = replace(
        truth(fine),
        temperature_interval=measurement_interval(whole),
        temperature_counts=counts_of(whole.temperature),
    )
    since_origin = conditions.time + (fine.stamp[0] - origin) * 1e-9
    unblocked = PreparedRun(
        name=name,
        device=recording.device,
        conditions=replace(conditions, time=since_origin),
        starts=np.zeros((0, 2), dtype=np.int64),
        slot=np.zeros(0, dtype=np.int64),
        period=period,
        measured={},
        fine_measured={s: _finite_or_nan(getattr(fine, SENSOR_FIELDS[s])) for s in SENSORS},
        cv_group=np.zeros(0, dtype=np.int64),
        has_cycles=False,
        origin=origin,
        sampled=sampled,
        rounding={s: Rounding.of(getattr(measured, SENSOR_FIELDS[s])) for s in SENSORS},
        hash=columns_hash(whole),
    )
    run = in_blocks(unblocked, period)
    notes += _block_notes(run, period)
    return replace(run, notes=tuple(f'{name}: {note}' for note in notes))


def _longest_stretch(recording: ImuRecording, name: str) -> ImuRecording:
    """Return the longest stretch of rows whose clock did not step."""
    if len(recording) < 2:
        raise RecordingError(f'{name}: {len(recording)} rows are too few for a run')
    stretch, jumped = longest_stretch('samples', recording.stamp)
    return recording.rows(stretch).with_notes(jumped) if jumped else recording


def _with_known_temperature(fine: ImuRecording, name: str, notes: Sequence[str]) -> ImuRecording:
    """Return the rows with a die temperature; the error of none names a topic found instead."""
    known = np.isfinite(fine.temperature)
    if known.any():
        return fine.rows(known)
    absent = f'no topic {TEMPERATURE_TOPIC}'
    found = next((f'; {note}' for note in notes if note.startswith(absent)), '')
    raise RecordingError(
        f'{name}: no sample has a die temperature (topic {TEMPERATURE_TOPIC}){found}'
    )


def _block_notes(run: PreparedRun, wanted_period: float) -> list[str]:
    """Return notes on what the blocks of a run hold, and on what was left out between them."""
    notes = []
    if 0 < wanted_period < run.period:
        notes.append(
            f'samples are {run.period:g} s apart: errors are on single samples, not on means'
        )
    holes = int(run.slot[-1] - run.slot[0] + 1 - len(run)) if len(run) else 0
    if holes:
        notes.append(
            f'{holes * run.period:.0f} s in gaps, half-empty blocks or where cycles meet left out'
        )
    if gaps := len(ends_of_long_gaps(run.conditions.time)):
        notes.append(
            f'{gaps} long {"gap" if gaps == 1 else "gaps"}: the thermal state after '
            f'{"it" if gaps == 1 else "them"} is unknown, and fitted beside the level'
        )
    if not run.has_cycles:
        count = int(run.cv_group.max(initial=0))
        notes.append(f'no thermal cycles: held out are {count} contiguous blocks of the run')
    return notes


def _finite_or_nan(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)
