# SPDX-License-Identifier: Apache-2.0
"""Serialise the tracks of a recording, each message where a reader needs it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imu_recording.cdr_layout import ENCAPSULATION, LAYOUTS, NANOSECONDS, encode_messages
from imu_recording.logging_contract import (
    IMU,
    IMU_TOPIC,
    MAGNETIC_TOPIC,
    PHASE_TOPIC,
    TEMPERATURE_TOPIC,
    TRACKS,
    Track,
)
from imu_recording.recording import PHASES, FloatArray, ImuRecording, IntArray

REPEAT_NS = 10 * NANOSECONDS
"""A track that does not change is repeated at this interval [ns]."""
ORDER = {TEMPERATURE_TOPIC: 1, IMU_TOPIC: 2, MAGNETIC_TOPIC: 3}
"""Order among equal stamps; chamber tracks come first."""
NO_ORIENTATION = {4: -1.0}
"""orientation_covariance[0] of an Imu that reports no orientation (REP-145)."""


@dataclass(frozen=True)
class EncodedTrack:
    """Serialised messages of one topic."""

    topic: str
    message_type: str
    rank: int
    stamp: IntArray
    messages: Sequence[Any]


def recorded_tracks(recording: ImuRecording) -> list[Track]:
    """Return the tracks the recording has; one that is NaN throughout was not recorded."""
    recorded = []
    for track in TRACKS:
        values = [getattr(recording, field) for field in track.fields]
        if all(value is None for value in values):
            continue
        absent = track.topic in (MAGNETIC_TOPIC, TEMPERATURE_TOPIC) and np.isnan(values[0]).all()
        if not absent:
            recorded.append(track)
    return recorded


def encode_tracks(recording: ImuRecording, first: int, last: int) -> list[EncodedTrack]:
    """Return the messages of rows first … last − 1 of every track the recording has."""
    return [_encoded(track, recording, first, last) for track in recorded_tracks(recording)]


def _encoded(track: Track, recording: ImuRecording, first: int, last: int) -> EncodedTrack:
    rank = ORDER.get(track.topic, 0)
    if track.topic == PHASE_TOPIC:
        rows = _phase_rows(recording, first, last)
        messages: Sequence[Any] = _phase_messages(recording, rows)
    else:
        groups = [getattr(recording, field) for field in track.fields]
        measured = recording.stamp
        if track.topic == TEMPERATURE_TOPIC and recording.temperature_stamp is not None:
            measured = recording.temperature_stamp
            rows = first + np.flatnonzero(_changed(measured, first, last))
            rows = rows[measured[rows] >= 0]
        else:
            rows = _rows_to_send(track, recording.stamp, groups, first, last)
        count = LAYOUTS[track.message_type].columns[0].count
        taken = tuple(group[rows].reshape(len(rows), count) for group in groups)
        constants = NO_ORIENTATION if track.message_type == IMU else None
        frame = '' if track.shared else recording.frame_id
        records = encode_messages(track.message_type, measured[rows], frame, taken, constants)
        size = records.shape[1]
        view = memoryview(records.tobytes())
        messages = [view[at : at + size] for at in range(0, len(view), size)]
    return EncodedTrack(track.topic, track.message_type, rank, recording.stamp[rows], messages)


def _rows_to_send(
    track: Track, stamp: IntArray, groups: Sequence[FloatArray], first: int, last: int
) -> IntArray:
    """Return the rows whose sample must be sent so that a reader rebuilds every row."""
    rows = np.arange(first, last)
    values = groups[0]
    if track.topic == IMU_TOPIC:
        return rows
    absent = np.isnan(values[first:last].reshape(len(rows), -1)).all(axis=1)
    if track.topic == MAGNETIC_TOPIC:
        return rows[~absent]
    send = np.ones(len(rows), bool)
    if track.topic != TEMPERATURE_TOPIC:
        send = _changed(values, first, last) | _due(stamp, first, last)
    if absent.any():
        begun = np.maximum.accumulate(~absent)
        if not begun.all() and first and not np.isnan(values[:first]).all():
            begun[:] = True
        send &= begun  # nothing is sent before the first sample
    return rows[send]


def _changed(values: NDArray[Any], first: int, last: int) -> NDArray[np.bool_]:
    """Tell which rows differ from the row before in any bit; the first row of all does."""
    words = np.ascontiguousarray(values[max(first - 1, 0) : last]).view(np.int64)
    words = words.reshape(last - max(first - 1, 0), -1)
    changed = (words[1:] != words[:-1]).any(axis=1)
    return changed if first else np.concatenate(([True], changed))


def _due(stamp: IntArray, first: int, last: int) -> NDArray[np.bool_]:
    """Tell which rows are the first of a new repetition interval."""
    turn = (stamp[max(first - 1, 0) : last] - stamp[0]) // REPEAT_NS
    due = np.diff(turn) > 0
    return due if first else np.concatenate(([True], due))


def _phase_rows(recording: ImuRecording, first: int, last: int) -> IntArray:
    send = np.zeros(last - first, bool)
    for values in (recording.phase, recording.cycle):
        if values is not None:
            send |= _changed(values, first, last)
    return np.arange(first, last)[send]


def _phase_messages(recording: ImuRecording, rows: IntArray) -> list[bytes]:
    n = len(rows)
    phase = recording.phase[rows] if recording.phase is not None else np.full(n, -1)
    cycle = recording.cycle[rows] if recording.cycle is not None else np.zeros(n, int)
    messages = []
    for p, c in zip(phase.tolist(), cycle.tolist(), strict=True):
        text = f'{PHASES[p] if 0 <= p < len(PHASES) else "unknown"} {c}'.encode() + b'\0'
        messages.append(ENCAPSULATION + len(text).to_bytes(4, 'little') + text)
    return messages
