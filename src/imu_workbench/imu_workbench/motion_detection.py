# SPDX-License-Identifier: Apache-2.0
"""Motion detection: a recording of a moving device cannot show its temperature error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording
from imu_recording.user_error import UserError
from scipy.ndimage import median_filter
from thermal_comp.data.binning import bin_means

SECOND_NS = 1_000_000_000
AROUND = 61
"""Seconds (samples, where these are slower) whose median is what a second is compared with."""
SHAKEN = 0.05
"""Specific force beside its usual one from which a device is moved about or tilted, as a share of
its size: in any unit, and above noise, vibration and what temperature does in a minute."""
TURNED = 0.17
"""The same of the magnetic field: turned by ten degrees."""
RATE = 0.017
"""Angular velocity that has to come with a turned field [rad/s]; a heater's current turns the
field as well, but no gyroscope."""
SHARE = 0.03
"""Share of the seconds that makes a moving recording: being put down or turned once is none."""
FEWEST = 3
"""Seconds that move in a recording that moves."""


class MovingError(UserError):
    """Recordings of a moving device where one at rest is needed."""


def motion_of(recording: ImuRecording) -> str:
    """Return how a device moves in a recording, '' where it rests.

    Means over a second are compared with the median of the minute around them: temperature is
    slower than that, noise and vibration are smaller.
    """
    if len(recording) < FEWEST:
        return ''
    second = (recording.stamp - recording.stamp[0]) // SECOND_NS
    starts = np.append(np.flatnonzero(np.diff(second, prepend=-1)), len(second)).astype(np.int64)
    force = bin_means(recording.linear_acceleration, starts)[0]
    field = bin_means(recording.magnetic_field, starts)[0]
    rate = _beside(bin_means(recording.angular_velocity, starts)[0])
    turned = (_beside(field) > TURNED * _size(field)) & (rate > RATE)
    moves = (_beside(force) > SHAKEN * _size(force)) | turned
    # A spike stands alone; what moves does so for more than a second.
    moves &= np.r_[False, moves[:-1]] | np.r_[moves[1:], False]
    if moves.sum() < max(FEWEST, SHARE * len(moves)):
        return ''
    fastest = np.degrees(rate.max())
    return f'the device moves in {moves.mean():.0%} of the time, turned by up to {fastest:.0f} °/s'


def resting(recordings: Sequence[ImuRecording]) -> tuple[list[ImuRecording], list[str]]:
    """Return the recordings of a device at rest, and what is said of each other one.

    Raise MovingError where there is no other.
    """
    kept, left_out = [], []
    for recording in recordings:
        motion = motion_of(recording)
        if motion:
            left_out.append(refusal(recording.run or recording.source, motion))
        else:
            kept.append(recording)
    if left_out and not kept:
        raise MovingError('; '.join(left_out))
    return kept, left_out


def with_motion_noted(recording: ImuRecording) -> ImuRecording:
    """Return the recording, with a note where its device moves."""
    motion = motion_of(recording)
    if not motion:
        return recording
    note = f'{motion}: temperature error is found on a device at rest, so doubt what is said here'
    return replace(recording, notes=(*recording.notes, note))


def refusal(name: str, motion: str) -> str:
    """Return what is said of a recording that moves: why it is no use here, and what to do."""
    return (
        f'{name} is left out: {motion}, and temperature error is found on a device at rest. '
        'Record it resting; what the error costs in motion says "python -m imu_workbench orient '
        'BAG --model MODEL"'
    )


def _beside(means: FloatArray) -> FloatArray:
    """Return (m,) how far each mean (m, 3) is from the median around it; 0 where unknown."""
    known = np.isfinite(means).all(axis=1)
    beside = np.zeros(len(means))
    if known.any():
        values = means[known]
        size = min(AROUND, len(values))
        usual = np.column_stack([median_filter(c, size=size, mode='nearest') for c in values.T])
        beside[known] = np.linalg.norm(values - usual, axis=1)
    return beside


def _size(means: FloatArray) -> float:
    """Return the usual norm; infinite where nothing is known."""
    sizes = np.linalg.norm(means, axis=1)
    known = np.isfinite(sizes)
    return float(np.median(sizes[known])) if known.any() else float('inf')
