# SPDX-License-Identifier: Apache-2.0
"""A device that was moved or turned while it was recorded: each part at rest is a run of its own.

The parts keep the whole recording's temperatures and channels, so that lags, warm-up and whatever
else has a memory know what was before; what the sensors measured is known in one part alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray, ImuRecording, infer_up_axis
from scipy.spatial.transform import Rotation

from thermal_comp.data.conditions import mounting_rotation
from thermal_comp.data.motion import Span, moved_spans
from thermal_comp.data.startup import startup_rows

LEAST_PART_SHARE = 0.05
"""Share of the rows below which a part is left out: too little to tell a level of its own."""
LEAST_SPAN_K = 5.0
"""Span of temperature that tells a slope [K]."""
LEAST_UNLIKENESS, LARGEST_REST = 0.5, 0.2
"""Slopes are others from half of their size on; turned with gravity where that leaves a fifth."""
AXIS_TURNS = tuple(Rotation.create_group('O').as_matrix().round())
"""The 24 turns that take axes to axes."""


@dataclass(frozen=True, eq=False)
class PartsAtRest:
    """The parts of a recording in which the device stood still."""

    recordings: Sequence[ImuRecording]
    """The recording itself where it was not moved."""
    left_out: int = 0
    """Rows that are in none of them."""
    is_turned: bool = False
    """Whether not the same axis points up in all of them."""
    text: str = ''
    """When it was moved, and what has become of the recording."""


def parts_at_rest(recording: ImuRecording) -> PartsAtRest:
    """Return the parts between short whiles of motion and lasting turns.

    The first keeps the name of the run, the others say from when they are. A device that is
    carried about, or that never has an axis up or down, has none: it is returned as it is.
    """
    moved = moved_spans(recording)
    if moved:  # what fills up after power-on changes as well, and is no motion
        started = startup_rows(recording)[0]
        moved = [span for span in moved if span[0] >= started]
    if not moved:
        return PartsAtRest([recording])
    edges = [0, *(edge for span in moved for edge in span), len(recording)]
    between = list(zip(edges[::2], edges[1::2], strict=True))
    least = min(LEAST_PART_SHARE * len(recording), max(stop - first for first, stop in between))
    ups = {span: _up_axis(recording, span) for span in between if span[1] - span[0] >= least}
    standing = {span: up for span, up in ups.items() if up}
    if not standing:
        return PartsAtRest([recording])
    seconds = recording.time
    times = ', '.join(f'{seconds[a]:.0f} … {seconds[b - 1]:.0f} s' for a, b in moved)
    text = f'the device was moved at {times}'
    turned = len(set(standing.values())) > 1
    if turned:
        text += f'; up are {", then ".join(standing.values())}'
    parts = [_part(recording, span, up) for span, up in standing.items()]
    longest = max(parts, key=_rows_measured)
    foreign = [part for part in parts if _has_other_axes(part, longest)]
    if foreign:
        text += (
            '; the temperature error turned with it, as if axes or signs had been changed in the '
            f'data: {sum(map(_rows_measured, foreign))} rows are left out'
        )
        parts = [part for part in parts if part not in foreign]
    if len(parts) > 1:
        text += f'; the {len(parts)} parts are runs of their own'
        others = [replace(part, notes=()) for part in parts[1:]]  # the first has the notes
        parts = [parts[0].with_notes(text), *others]
    return PartsAtRest(parts, len(recording) - sum(map(_rows_measured, parts)), turned, text)


def all_parts_at_rest(recordings: Iterable[ImuRecording]) -> list[ImuRecording]:
    """Return the parts of all recordings, in order."""
    return [part for whole in recordings for part in parts_at_rest(whole).recordings]


def _up_axis(recording: ImuRecording, span: Span) -> str:
    """Return the axis that points up in some rows; the stated one where gravity tells none."""
    force = recording.linear_acceleration
    stated = '' if infer_up_axis(force) else recording.up_axis
    return infer_up_axis(force[slice(*span)]) or stated


def _has_other_axes(part: ImuRecording, other: ImuRecording) -> bool:
    """Whether the slopes of the specific force turn with gravity, as those of a sensor do not.

    Along the axes that point up a scale factor's own slope changes its sign: they do not count.
    """
    own, theirs = _slope(part), _slope(other)
    if part.up_axis == other.up_axis or own is None or theirs is None:
        return False
    across = [k for k in range(3) if 'xyz'[k] not in part.up_axis + other.up_axis]
    unlike = np.linalg.norm((own - theirs)[across])
    if unlike < LEAST_UNLIKENESS * np.linalg.norm(theirs[across]):
        return False
    up, up_there = mounting_rotation(part.up_axis)[:, 2], mounting_rotation(other.up_axis)[:, 2]
    turns = (turn for turn in AXIS_TURNS if np.array_equal(turn @ up_there, up))
    left = min(np.linalg.norm((own - turn @ theirs)[across]) for turn in turns)
    return bool(left < LARGEST_REST * unlike)


def _slope(recording: ImuRecording) -> FloatArray | None:
    """Return the (3,) slopes of the specific force over temperature; None of too short a span."""
    force, temperature = recording.linear_acceleration, recording.temperature
    known = np.flatnonzero(np.isfinite(force).all(axis=1) & np.isfinite(temperature))
    known = known[:: max(1, len(known) // 20_000)]
    if not len(known) or np.ptp(temperature[known]) < LEAST_SPAN_K:
        return None
    slopes: FloatArray = np.polyfit(temperature[known], force[known], 1)[0]
    return slopes


def _rows_measured(recording: ImuRecording) -> int:
    """Return how many rows hold anything that was measured."""
    tracks = [getattr(recording, name) for name in SENSOR_FIELDS.values()]
    return int(np.isfinite(np.concatenate(tracks, axis=1)).any(axis=1).sum())


def _part(recording: ImuRecording, span: Span, up_axis: str) -> ImuRecording:
    """Return the recording with what was measured in some rows alone."""
    first, stop = span
    measured: dict[str, Any] = {}
    for name in SENSOR_FIELDS.values():
        measured[name] = np.full_like(getattr(recording, name), np.nan)
        measured[name][first:stop] = getattr(recording, name)[first:stop]
    name = recording.run or recording.source.rstrip('/').rpartition('/')[2]
    later = f' from {recording.time[first]:.0f} s' if first else ''
    return replace(recording, run=f'{name}{later}'.strip(), up_axis=up_axis, **measured)
