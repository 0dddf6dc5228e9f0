# SPDX-License-Identifier: Apache-2.0
"""Join the columns of each topic to one recording."""

from __future__ import annotations

import itertools
import unicodedata
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from imu_recording.bags.decoding.topic_columns import TopicColumns
from imu_recording.held_temperature import note_held
from imu_recording.logging_contract import (
    IMU_TOPIC,
    MAGNETIC_TOPIC,
    PHASE_TOPIC,
    TEMPERATURE_TOPIC,
    TRACK_OF_TOPIC,
)
from imu_recording.phase import parse_phase, phases_from_setpoint
from imu_recording.recording import (
    UP_AXES,
    BagError,
    FloatArray,
    ImuRecording,
    IntArray,
    infer_up_axis,
)
from imu_recording.synchronise import (
    Joined,
    Samples,
    hold_newest,
    in_order,
    join_next,
    without_jumps,
)

LINE_BREAKING_CATEGORIES = ('Cc', 'Zl', 'Zp')
"""Unicode categories of control characters, line and paragraph separators."""
CLOCK_UNIT_SHARE = 0.05
"""Largest relative distance from a factor of a thousand or a million that shows another unit."""


def assemble_recording(
    columns: Mapping[str, TopicColumns],
    metadata: Mapping[str, str],
    namespace: str,
    source: str,
    notes: list[str],
) -> ImuRecording:
    """Sort and join the topics of one device onto the rows of imu/data_raw."""
    notes = list(notes)
    metadata = {key: _one_line(value) for key, value in metadata.items()}
    by_name = {column.track.topic: column for column in columns.values() if column.count}
    if IMU_TOPIC in by_name:
        _refuse_other_clock_unit(by_name[IMU_TOPIC].clock_ratio, source)
    for column in columns.values():
        notes += _topic_notes(column)
    samples = {name: _samples(name, column, notes) for name, column in by_name.items()}
    stamp = samples[IMU_TOPIC].stamp
    tracks, unplaced = _tracks(samples, notes)
    _fill_absent(tracks, len(stamp), notes)
    _derive_phase(tracks, stamp, notes)
    return ImuRecording(
        stamp=stamp,
        **tracks,
        frame_id=_frame_id(by_name, notes),
        device=metadata.get('device', namespace.strip('/')),
        run=metadata.get('run', ''),
        up_axis=_up_axis(metadata.get('up_axis', ''), tracks['linear_acceleration'], notes),
        profile=metadata.get('profile', ''),
        compensated=metadata.get('compensated', ''),
        simulated=metadata.get('simulated', ''),
        namespace=namespace,
        source=source,
        notes=tuple(notes),
        unplaced=unplaced,
    )


def _one_line(text: str) -> str:
    """Return a name without what would break, or write over, the line it is printed in."""
    return ''.join(' ' if unicodedata.category(c) in LINE_BREAKING_CATEGORIES else c for c in text)


def _refuse_other_clock_unit(ratio: float, source: str) -> None:
    """Raise BagError where stamps were written in a unit of their own."""
    for factor, slower in itertools.product((1e3, 1e6), (True, False)):
        if abs(ratio / factor - 1.0 if slower else ratio * factor - 1.0) < CLOCK_UNIT_SHARE:
            raise BagError(
                f'{source}: the stamps of {IMU_TOPIC} advance {factor:.0f} times '
                f'{"slower" if slower else "faster"} than the times of receipt, as if in another '
                'unit than seconds and nanoseconds: mend what writes the stamps and record again'
            )


def _tracks(
    samples: dict[str, Samples], notes: list[str]
) -> tuple[dict[str, Any], dict[str, int]]:
    """Return the recording's columns by field, and topic → samples without a row.

    Takes the samples out one by one, so that no more than one topic is in memory twice.
    """
    rows = samples.pop(IMU_TOPIC)
    tracks: dict[str, Any] = dict(zip(TRACK_OF_TOPIC[IMU_TOPIC].fields, rows.values, strict=True))
    unplaced: dict[str, int] = {}
    for name in list(samples):
        joined, found = _joined(name, rows.stamp, samples.pop(name))
        tracks |= found
        notes += joined.notes
        if joined.unplaced:
            unplaced[name] = joined.unplaced
    measured = tracks.get('temperature_stamp')
    if measured is not None and ((measured == rows.stamp) | (measured < 0)).all():
        del tracks['temperature_stamp']  # each was measured at its row
    if 'temperature' in tracks:
        held = note_held(tracks.get('temperature_stamp', rows.stamp), tracks['temperature'], notes)
        if held is not None:
            tracks['temperature_stamp'] = held
    return tracks, unplaced


def _fill_absent(tracks: dict[str, Any], rows: int, notes: list[str]) -> None:
    """Fill what every recording has with NaN where its topic has no samples."""
    for name, field, shape in (
        (MAGNETIC_TOPIC, 'magnetic_field', (rows, 3)),
        (TEMPERATURE_TOPIC, 'temperature', (rows,)),
    ):
        if field not in tracks:
            tracks[field] = np.full(shape, np.nan)
            notes.append(f'no samples on {name}: {field} is NaN')


def _derive_phase(tracks: dict[str, Any], stamp: IntArray, notes: list[str]) -> None:
    """Add phase and cycle from the set-point where they were not logged."""
    if 'phase' not in tracks and 'setpoint' in tracks:
        time = (stamp - stamp[0]) * 1e-9
        tracks['phase'], tracks['cycle'] = phases_from_setpoint(time, tracks['setpoint'])
        notes.append('phase and cycle are derived from chamber/setpoint')


def _topic_notes(column: TopicColumns) -> list[str]:
    name = column.track.topic
    notes = []
    if column.undecodable:
        notes.append(f'{name}: {column.undecodable} damaged messages left out')
    if column.slow:
        notes.append(f'{name}: {column.slow} messages of unusual layout decoded one by one')
    if column.unreported:
        notes.append(f'{name}: {column.unreported} vectors marked as not reported are NaN')
    if column.unstamped and column.track.message_type != 'std_msgs/msg/Float64':
        notes.append(f'{name}: stamps are not set, times of receipt stand in')
    return notes


def _samples(name: str, column: TopicColumns, notes: list[str]) -> Samples:
    stamp, values = column.hand_over()
    fields = column.track.fields
    for field, group in zip(fields, values, strict=False):  # a text has no values yet
        _blank_infinities(f'{name} {field}' if len(fields) > 1 else name, group, notes)
    if name == PHASE_TOPIC:
        parsed = {text: parse_phase(text) for text in set(column.texts)}
        unknown = sorted(text for text, (phase, _) in parsed.items() if phase < 0)
        if unknown:
            notes.append(f'{name}: {unknown[0]!r} is no phase; such rows are −1')
        pairs = np.array([parsed[text] for text in column.texts], float)
        values = [pairs[:, :1], pairs[:, 1:]]
    samples = in_order(name, stamp, values)
    if name == IMU_TOPIC:  # its stamps are the rows'
        samples = without_jumps(name, samples)
    notes += samples.notes
    return samples


def _blank_infinities(name: str, values: FloatArray, notes: list[str]) -> None:
    """Turn infinities into NaN, in place, and count what is not a number."""
    with np.errstate(over='ignore', invalid='ignore'):
        total = values.sum()  # finite: no infinity among them
    if np.isfinite(total):
        return
    infinite = np.isinf(values)
    bad = int(np.count_nonzero((infinite | np.isnan(values)).any(axis=1)))
    if bad:
        values[infinite] = np.nan
        notes.append(f'{name}: {bad} of {len(values)} samples are NaN or infinite, kept as NaN')


def _joined(
    name: str, stamp: IntArray, samples: Samples
) -> tuple[Joined, dict[str, FloatArray | IntArray]]:
    """Return a topic on the rows, and the fields of the recording it fills."""
    track = TRACK_OF_TOPIC[name]
    fields = track.fields
    if not track.held:
        joined = join_next(name, stamp, samples)
    else:
        if name == TEMPERATURE_TOPIC and not np.array_equal(stamp, samples.stamp):
            fields = (*fields, 'temperature_stamp')
            samples = replace(samples, values=(*samples.values, samples.stamp[:, np.newaxis]))
        joined = hold_newest(name, stamp, samples, event=track.event)
    found: dict[str, FloatArray | IntArray] = {}
    for field, values in zip(fields, joined.values, strict=True):
        if name == PHASE_TOPIC:
            blank = -1 if field == 'phase' else 0
            column = values[:, 0]
            found[field] = np.where(np.isnan(column), blank, column).astype(np.int64)
        else:
            found[field] = values[:, 0] if values.shape[1] == 1 else values
    return joined, found


def _frame_id(by_name: Mapping[str, TopicColumns], notes: list[str]) -> str:
    imu = by_name[IMU_TOPIC].frames
    frame = imu.most_common(1)[0][0] if imu else ''
    if len(imu) > 1:
        listed = ', '.join(f'{name} ({count})' for name, count in imu.most_common())
        notes.append(f'{IMU_TOPIC}: several frame_ids: {listed}')
    others = by_name[MAGNETIC_TOPIC].frames if MAGNETIC_TOPIC in by_name else {}
    if others and set(others) != set(imu):
        notes.append(f'{MAGNETIC_TOPIC}: frame_id {", ".join(sorted(others))} is not {frame}')
    return frame


def _up_axis(stated: str, linear_acceleration: FloatArray, notes: list[str]) -> str:
    inferred = infer_up_axis(linear_acceleration)
    if stated and stated not in UP_AXES:
        notes.append(f'up_axis {stated!r} in the metadata is none of {", ".join(UP_AXES)}')
        stated = ''
    if not stated and inferred:
        notes.append(f'up_axis {inferred} is inferred from gravity')
    if stated and inferred and stated != inferred:
        notes.append(f'up_axis is {stated} in the metadata, gravity says {inferred}')
    return stated or inferred
