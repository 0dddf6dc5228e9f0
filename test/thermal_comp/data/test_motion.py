# SPDX-License-Identifier: Apache-2.0
"""A device that moves is told from one at rest, whatever defects the data have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_recording.recording import SENSOR_FIELDS
from thermal_comp.data.motion import MovingError, motion_of, moved_spans, refuse_moving, resting
from thermal_comp.data.quality import check_quality

from imu_recording import ImuRecording

from ..campaign import run


def tilted(recording: ImuRecording) -> ImuRecording:
    """The recording of a device that is tilted to and fro."""
    swing = np.radians(40.0) * np.sin(2 * np.pi * recording.time / 30.0)
    force = recording.linear_acceleration.copy()
    force[:, 0] += 9.81 * np.sin(swing)
    force[:, 2] += 9.81 * (np.cos(swing) - 1.0)
    return replace(recording, linear_acceleration=force, run='carried')


def test_a_recording_that_moves_is_left_out_with_a_note() -> None:
    still = run(cycles=1, seed=1)
    kept, notes = resting([still, tilted(still)])
    assert kept == [still]
    assert len(notes) == 1
    assert 'carried' in notes[0]
    refuse_moving(still)
    for refuse in (refuse_moving, lambda one: resting([one])):
        with pytest.raises(MovingError, match='the device moves in '):
            refuse(tilted(still))


def test_a_device_turned_level_moves() -> None:
    still = run(cycles=1, seed=1)
    heading = np.radians(60.0) * np.sin(2 * np.pi * still.time / 60.0)
    rate = np.gradient(heading, still.time)
    field = still.magnetic_field.copy()
    field[:, 0] = 2e-5 * np.cos(heading)
    field[:, 1] = 2e-5 * np.sin(heading)
    velocity = still.angular_velocity + rate[:, None] * [0.0, 0.0, 1.0]
    turning = replace(still, magnetic_field=field, angular_velocity=velocity)
    assert motion_of(turning).startswith('the device moves in ')


def test_a_device_at_rest_does_not_move_whatever_its_data_suffer() -> None:
    still = run(cycles=2, seed=1)
    in_degrees = np.degrees(still.angular_velocity)
    rng = np.random.default_rng(5)
    spiky = still.linear_acceleration.copy()
    spiky[rng.integers(0, len(still), 20)] = 30.0
    turned_once = still.linear_acceleration.copy()
    turned_once[len(still) // 2 :] = np.roll(turned_once[len(still) // 2 :], 1, axis=1)
    glitches = still.linear_acceleration.copy()
    glitches[rng.random(len(still)) < 0.08] += 15.0
    switched = still.magnetic_field + 2e-5 * (still.time[:, None] % 40.0 < 12.0)
    for values in (
        {'magnetic_field': switched},
        {'linear_acceleration': glitches},
        {'angular_velocity': in_degrees},
        {'linear_acceleration': still.linear_acceleration / 9.81},
        {'linear_acceleration': spiky},
        {'linear_acceleration': turned_once},
        {'magnetic_field': np.full((len(still), 3), np.nan)},
    ):
        assert motion_of(replace(still, **values)) == '', list(values)


def test_a_recording_too_short_to_show_motion_rests() -> None:
    still = run(cycles=1, seed=1)
    for rows in (0, 2):
        short = still.rows(slice(0, rows))
        assert not motion_of(short)
        assert not moved_spans(short)


def test_a_device_that_is_picked_up_is_left_out_while_it_moves() -> None:
    still = run(cycles=1, seed=1, period=1.0)
    at = (still.time >= 3000.0) & (still.time < 3060.0)
    shake = np.random.default_rng(3).standard_normal((len(still), 3))
    force, velocity = still.linear_acceleration.copy(), still.angular_velocity.copy()
    force[at] += 3.0 * shake[at]
    velocity[at] += 1.0 * shake[at]
    force[still.time >= 3060.0, 0] += 0.8
    moved = replace(still, linear_acceleration=force, angular_velocity=velocity)
    assert not motion_of(moved)
    clean, findings = check_quality([moved])
    assert [finding.name for finding in findings] == ['moved']
    assert 'was moved at 30' in findings[0].text
    for name in SENSOR_FIELDS.values():
        known = np.isfinite([getattr(part, name) for part in clean]).all(axis=2).sum(axis=0)
        assert (known[at] == 0).mean() > 0.95
        assert (known[~at] == 1).mean() > 0.999


@pytest.mark.parametrize('rows', [slice(0, 10), slice(590, 600)])
def test_a_second_in_another_attitude_at_an_end_is_motion(rows: slice) -> None:
    """A hand lets go of the device, or a log goes on in a file that an earlier one left."""
    still = run(cycles=1, seed=1, period=1.0).rows(slice(0, 600))
    still = replace(still, stamp=still.stamp[0] + 100_000_000 * np.arange(600))
    force = still.linear_acceleration.copy()
    force[rows, 0] += 0.9
    assert moved_spans(replace(still, linear_acceleration=force)) == [(rows.start, rows.stop)]
    force[rows.start : rows.start + 4] = np.nan
    assert moved_spans(replace(still, linear_acceleration=force)) == [(rows.start, rows.stop)]
    force = still.linear_acceleration.copy()
    force[rows.start] += 9.0
    assert not moved_spans(replace(still, linear_acceleration=force))


def test_noise_as_loud_as_a_tilt_moves_no_device() -> None:
    """A tiltmeter that reads once a second, to 18 mg: now and then two of its samples are far."""
    still = run(cycles=2, seed=1, period=1.0)
    noise = 0.18 * np.random.default_rng(8).standard_normal((len(still), 3))
    assert not moved_spans(replace(still, linear_acceleration=still.linear_acceleration + noise))


def test_a_device_that_warms_up_between_bursts_rests() -> None:
    still = run(cycles=2, seed=1, period=1.0)
    warm = still.linear_acceleration + 0.06 * (still.temperature - 20.0)[:, None]
    bursts = replace(still, linear_acceleration=warm).rows(
        np.flatnonzero(still.time % 900.0 < 5.0)
    )
    assert motion_of(bursts) == ''
    assert not moved_spans(bursts)
