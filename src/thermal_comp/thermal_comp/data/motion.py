# SPDX-License-Identifier: Apache-2.0
"""Motion detection: a recording of a moving device cannot show its temperature error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from imu_recording.recording import SECOND_NS, FloatArray, ImuRecording, IntArray
from imu_recording.user_error import UserError
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter

from thermal_comp.data.binning import bin_means

MEDIAN_WINDOW_S = 61
"""Length of the running median that means over a second are compared with [s, or samples where
these are slower]."""
LEAST_FORCE_CHANGE = 0.05
"""Change of specific force, as a share of its norm, from which a device is moved or tilted: above
noise, vibration and the temperature error of a minute, whatever the unit."""
LEAST_FIELD_CHANGE = 0.17
"""Change of the magnetic field, as a share of its norm, from which a device is turned: by ten
degrees."""
LEAST_TURN_RATE = 0.017
"""Angular velocity a turn of the field has to come with [rad/s]: a heater's current turns the
field without turning the device."""
LEAST_MOVING_SHARE = 0.03
"""Share of seconds with motion from which a recording is of a moving device; one turn is less."""
LEAST_MOVING_SECONDS = 3
"""Least number of such seconds."""
LEAST_NOISE_RATIO = 4.0
"""Distance from what is usual over its median that noise does not reach: of vectors of normal
noise one in 10⁷ does."""
LEAST_ROWS = 5
"""Samples of a second that tell motion from a spike at the beginning or end of a recording."""
TURN_MEANS = 5
"""Means within which what is usual steps when the device is put down in another attitude."""
LARGEST_NORM_SHARE = 0.5
"""Change of the norm, as a share of a step, from which a step is no turn but a sensor's own."""

Span: TypeAlias = tuple[int, int]
"""First row, and the one after the last."""


class MovingError(UserError):
    """Recordings of a moving device where one at rest is needed."""


def motion_of(recording: ImuRecording) -> str:
    """Return how a device moves in a recording, '' where it rests, but for a short while.

    Means over a second are compared with the median of the minute around them: temperature is
    slower than that, noise and vibration are smaller.
    """
    seconds = _Seconds.of(recording)
    if not seconds.is_carried:
        return ''
    fastest = np.degrees(seconds.rate.max())
    turned_by = f', turned by up to {fastest:.0f} °/s' if fastest >= 1.0 else ''
    return f'the device moves in {seconds.moves.mean():.0%} of the time{turned_by}'


def moved_spans(recording: ImuRecording) -> list[Span]:
    """Return first row and stop of each short while of motion and of each lasting turn.

    At its beginning and end, where a hand lets go of the device or a log was appended to, a second
    is a while.

    None where the device moves for longer: then nothing shows its temperature error.
    """
    seconds = _Seconds.of(recording)
    if seconds.is_carried:
        return []
    moves = seconds.moves & seconds.beyond_noise
    lasts = moves.sum() >= LEAST_MOVING_SECONDS
    places = np.flatnonzero((moves & lasts) | seconds.turns | seconds.ends)
    if not len(places):
        return []
    whiles = np.split(places, np.flatnonzero(np.diff(places) > MEDIAN_WINDOW_S) + 1)
    return [(int(seconds.starts[some[0]]), int(seconds.starts[some[-1] + 1])) for some in whiles]


@dataclass(frozen=True, eq=False)
class _Seconds:
    """Means over a second: which rows they are of, and whether the device moves in them."""

    starts: IntArray
    """(m + 1,) first row of each, and the number of rows."""
    moves: NDArray[np.bool_]
    """(m,)."""
    beyond_noise: NDArray[np.bool_]
    """(m,) whether they are further from what is usual than noise takes them."""
    turns: NDArray[np.bool_]
    """(m,) those beside a change of attitude that lasts."""
    ends: NDArray[np.bool_]
    """(m,) those at the beginning and the end in another attitude."""
    rate: FloatArray
    """(m,) change of the angular velocity [rad/s]."""

    @property
    def is_carried(self) -> bool:
        """Whether the device moves for more than a short while."""
        share = LEAST_MOVING_SHARE * len(self.moves)
        return bool(self.moves.sum() >= max(LEAST_MOVING_SECONDS, share))

    @classmethod
    def of(cls, recording: ImuRecording) -> _Seconds:
        """Return those of a recording, none of one too short to show motion."""
        if len(recording) < LEAST_MOVING_SECONDS:
            none = np.zeros(0, bool)
            return cls(np.zeros(1, np.int64), none, none, none, none, np.zeros(0))
        second = (recording.stamp - recording.stamp[0]) // SECOND_NS
        starts = np.append(np.flatnonzero(np.diff(second, prepend=-1)), len(second))
        starts = starts.astype(np.int64)
        time = (recording.stamp[starts[:-1]] - recording.stamp[0]) * 1e-9
        force = _Means.of(recording.linear_acceleration, starts, time)
        field = _Means.of(recording.magnetic_field, starts, time)
        rate = _Means.of(recording.angular_velocity, starts, time).distance
        is_turning = rate > LEAST_TURN_RATE
        moves = force.distance > LEAST_FORCE_CHANGE * force.norm
        moves |= (field.distance > LEAST_FIELD_CHANGE * field.norm) & is_turning
        # A single second is a spike; motion lasts longer.
        moves &= np.r_[False, moves[:-1]] | np.r_[moves[1:], False]
        turns = force.turns(LEAST_FORCE_CHANGE)
        turns |= field.turns(LEAST_FIELD_CHANGE) & maximum_filter1d(is_turning, TURN_MEANS)
        ends = force.ends(recording.linear_acceleration, starts)
        beyond = np.logical_or(
            *(
                means.distance > LEAST_NOISE_RATIO * np.median(means.distance)
                for means in (force, field)
            )
        )
        return cls(starts, moves, beyond, turns, ends, rate)


@dataclass(frozen=True, eq=False)
class _Means:
    """Means of a vector over a second, and what is usual around them."""

    time: FloatArray
    """(m,) when each begins [s]."""
    usual: FloatArray
    """(m, 3) running median over MEDIAN_WINDOW_S; it follows a step at once, and begins anew after
    a gap of as much, as in bursts. NaN where unknown."""
    distance: FloatArray
    """(m,) how far each is from it; 0 where unknown."""
    norm: float
    """Median norm; infinite where nothing is known."""

    @classmethod
    def of(cls, values: FloatArray, starts: IntArray, time: FloatArray) -> _Means:
        means = bin_means(values, starts)[0]
        known = np.flatnonzero(np.isfinite(means).all(axis=1))
        usual, distance = np.full(means.shape, np.nan), np.zeros(len(means))
        if not len(known):
            return cls(time, usual, distance, float('inf'))
        for rows in np.split(known, np.flatnonzero(np.diff(time[known]) > MEDIAN_WINDOW_S) + 1):
            for axis, column in enumerate(means[rows].T):  # mirrored at its ends
                usual[rows, axis] = median_filter(column, MEDIAN_WINDOW_S, mode='reflect')
        distance[known] = np.linalg.norm(means[known] - usual[known], axis=1)
        return cls(time, usual, distance, float(np.median(np.linalg.norm(means[known], axis=1))))

    def turns(self, least: float) -> NDArray[np.bool_]:
        """Return the (m,) means beside a step of what is usual by `least` of the norm.

        A step over more than a minute (of bursts, and of slow sampling) may be temperature's,
        unless another axis points up; one that changes the norm may be the sensor's own.
        """
        turns = np.zeros(len(self.time), dtype=bool)
        known = np.flatnonzero(np.isfinite(self.usual).all(axis=1))
        known = known[LEAST_MOVING_SECONDS:-LEAST_MOVING_SECONDS]  # a start or end is no turn
        before, after = self.usual[known[:-TURN_MEANS]], self.usual[known[TURN_MEANS:]]
        step = np.linalg.norm(after - before, axis=1)
        norms = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
        taken = self.time[known[TURN_MEANS:]] - self.time[known[:-TURN_MEANS]]
        soon = taken <= MEDIAN_WINDOW_S
        other = np.abs(before).argmax(axis=1) != np.abs(after).argmax(axis=1)
        other |= (before * after).sum(axis=1) < 0.0
        found = (step > least * self.norm) & (soon | other)
        found &= np.abs(norms[1] - norms[0]) < LARGEST_NORM_SHARE * step
        turns[known[TURN_MEANS // 2 : -TURN_MEANS + TURN_MEANS // 2][found]] = True
        return turns

    def ends(self, values: FloatArray, starts: IntArray) -> NDArray[np.bool_]:
        """Return the (m,) means before the first and after the last that is near what is usual.

        So are most of their samples `values` (n, 3), of which there are some: a spike is none, and
        slower than LEAST_ROWS a second nothing is told.
        """
        least, known = LEAST_FORCE_CHANGE * self.norm, np.isfinite(self.usual).all(axis=1)
        near = np.flatnonzero(known & (self.distance <= least))
        if not len(near):
            return np.zeros(len(known), dtype=bool)
        ends = known.copy()
        ends[near[0] : near[-1] + 1] = False
        for place in np.flatnonzero(ends):
            rows = values[starts[place] : starts[place + 1]]
            apart = np.linalg.norm(rows[np.isfinite(rows).all(axis=1)] - self.usual[place], axis=1)
            ends[place] = len(apart) >= LEAST_ROWS and np.mean(apart > least) > 0.5
        return ends


def resting(recordings: Sequence[ImuRecording]) -> tuple[list[ImuRecording], list[str]]:
    """Return the recordings of a device at rest, and a note on each that is left out.

    Raise MovingError where there is no other.
    """
    kept, left_out = [], []
    for recording in recordings:
        motion = motion_of(recording)
        if motion:
            left_out.append(left_out_note(recording.run or recording.source, motion))
        else:
            kept.append(recording)
    if left_out and not kept:
        raise MovingError('; '.join(left_out))
    return kept, left_out


def refuse_moving(recording: ImuRecording) -> None:
    """Raise MovingError where the device moves."""
    motion = motion_of(recording)
    if motion:
        raise MovingError(f'{recording.source or recording.run}: {_why(motion)}')


def noted(recording: ImuRecording) -> ImuRecording:
    """Return the recording with a note where the device moves."""
    motion = motion_of(recording)
    return recording.with_notes(_why(motion)) if motion else recording


def left_out_note(name: str, motion: str) -> str:
    """Return the note on a moving recording: why it is left out, and what to do instead."""
    return f'{name} is left out: {_why(motion)}'


def _why(motion: str) -> str:
    return (
        f'{motion}, and temperature error is found on a device at rest. '
        'Record it resting; "python -m imu_workbench orient BAG --model MODEL" says what the '
        'error costs in motion'
    )
