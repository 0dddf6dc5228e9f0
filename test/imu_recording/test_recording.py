# SPDX-License-Identifier: Apache-2.0
"""The recording keeps its columns together and refuses what does not fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_recording.recording import infer_up_axis
from recording_samples import arrays, make_recording

from imu_recording import RecordingError


def test_rows_take_every_track_alike() -> None:
    recording = make_recording(50)
    chosen = np.arange(50) % 3 == 1
    for selection in (chosen, slice(5, 20, 2), np.array([3, 7, 30])):
        part = recording.rows(selection)
        whole = arrays(recording)
        assert sorted(arrays(part)) == sorted(whole)
        for name, column in arrays(part).items():
            assert np.array_equal(column, whole[name][selection], equal_nan=True), name
    assert part.device == recording.device


def test_time_is_exact_where_epoch_seconds_are_not() -> None:
    recording = make_recording(3, step_ns=1)
    assert recording.time.tolist() == [0.0, 1e-9, 2e-9]
    assert recording.rows(slice(0, 0)).time.shape == (0,)


def test_wrong_shapes_and_axes_are_refused() -> None:
    recording = make_recording(4)
    with pytest.raises(RecordingError, match=r'temperature has shape \(3,\), expected \(4,\)'):
        replace(recording, temperature=np.zeros(3))
    with pytest.raises(RecordingError, match=r'vibration has shape \(4, 2\), expected \(4, 3\)'):
        replace(recording, vibration=np.zeros((4, 2)))
    with pytest.raises(RecordingError, match="up_axis 'up' is none of"):
        replace(recording, up_axis='up')


def test_notes_are_added() -> None:
    assert make_recording(2).with_notes('a').with_notes('b', 'c').notes == ('a', 'b', 'c')


@pytest.mark.parametrize('axis', range(3))
@pytest.mark.parametrize('sign', [1, -1])
def test_gravity_tells_the_up_axis(axis: int, sign: int) -> None:
    rng = np.random.default_rng(axis)
    force = rng.normal(0, 0.3, (500, 3))
    force[:, axis] += sign * 9.8
    force[7] = np.nan
    assert infer_up_axis(force) == f'{"+" if sign > 0 else "-"}{"xyz"[axis]}'


def test_no_up_axis_where_gravity_does_not_tell() -> None:
    tilted = np.tile([6.9, 0.0, 6.9], (100, 1))
    turning = np.repeat([[9.8, 0, 0], [0, 9.8, 0]], 50, axis=0)
    in_counts = np.tile([0.0, 0.0, 16384.0], (100, 1))
    for force in (tilted, turning, in_counts, np.zeros((5, 3)), np.full((5, 3), np.nan)):
        assert infer_up_axis(force) == ''
