# SPDX-License-Identifier: Apache-2.0
"""Motion detection: a recording of a moving device cannot show its temperature error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import SECOND_NS, FloatArray, ImuRecording, IntArray
from imu_recording.user_error import UserError
from numpy.typing import NDArray
from scipy.ndimage import median_filter

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


def moved_rows(recording: ImuRecording) -> NDArray[np.bool_]:
    """Return the (n,) rows from the first to the last second of each short while of motion.

    None where the device moves for longer: then nothing shows its temperature error.
    """
    seconds, rows = _Seconds.of(recording), np.zeros(len(recording), dtype=bool)
    places = np.flatnonzero(seconds.moves)
    if len(places) < LEAST_MOVING_SECONDS or seconds.is_carried:
        return rows
    for some in np.split(places, np.flatnonzero(np.diff(places) > MEDIAN_WINDOW_S) + 1):
        rows[seconds.starts[some[0]] : seconds.starts[some[-1] + 1]] = True
    return rows


@dataclass(frozen=True, eq=False)
class _Seconds:
    """Means over a second: which rows they are of, and whether the device moves in them."""

    starts: IntArray
    """(m + 1,) first row of each, and the number of rows."""
    moves: NDArray[np.bool_]
    """(m,)."""
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
            return cls(np.zeros(1, np.int64), np.zeros(0, bool), np.zeros(0))
        second = (recording.stamp - recording.stamp[0]) // SECOND_NS
        starts = np.append(np.flatnonzero(np.diff(second, prepend=-1)), len(second))
        starts = starts.astype(np.int64)
        force = bin_means(recording.linear_acceleration, starts)[0]
        field = bin_means(recording.magnetic_field, starts)[0]
        rate = _distance_from_median(bin_means(recording.angular_velocity, starts)[0])
        turned = _distance_from_median(field) > LEAST_FIELD_CHANGE * _usual_norm(field)
        turned &= rate > LEAST_TURN_RATE
        moves = (_distance_from_median(force) > LEAST_FORCE_CHANGE * _usual_norm(force)) | turned
        # A single second is a spike; motion lasts longer.
        moves &= np.r_[False, moves[:-1]] | np.r_[moves[1:], False]
        return cls(starts, moves, rate)


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


def _distance_from_median(means: FloatArray) -> FloatArray:
    """Return (m,) how far each mean (m, 3) is from the median around it; 0 where unknown."""
    known = np.isfinite(means).all(axis=1)
    distance = np.zeros(len(means))
    if known.any():
        values = means[known]
        size = min(MEDIAN_WINDOW_S, len(values))
        usual = np.column_stack([median_filter(c, size=size, mode='nearest') for c in values.T])
        distance[known] = np.linalg.norm(values - usual, axis=1)
    return distance


def _usual_norm(means: FloatArray) -> float:
    """Return the median norm; infinite where nothing is known."""
    sizes = np.linalg.norm(means, axis=1)
    known = np.isfinite(sizes)
    return float(np.median(sizes[known])) if known.any() else float('inf')
