# SPDX-License-Identifier: Apache-2.0
"""Angles relative to the start are those that were turned by, also across ±180°."""

from dataclasses import replace

import numpy as np
import pytest
from imu_workbench.report.attitude import (
    ANGLE_COLUMNS,
    angle_statistics,
    angles_from_start,
    estimate_attitudes,
)
from orientation_filters.filters import state_bytes
from orientation_filters.rotation.arrays import from_rotation_vector, multiply
from orientation_filters.upsampling import upsample


def turned(angle_deg: np.ndarray, axis: int, start: np.ndarray) -> np.ndarray:
    vector = np.zeros((len(angle_deg), 3))
    vector[:, axis] = np.radians(angle_deg)
    return multiply(from_rotation_vector(vector), start)


@pytest.mark.parametrize('up', [(0, 0, 0, 1), (0, 0.5**0.5, 0, 0.5**0.5), (0.5, 0.5, 0.5, 0.5)])
def test_heading_and_inclination_are_told_apart_in_any_pose(up) -> None:
    seconds = np.arange(0.0, 400.0)
    turn = np.where(seconds < 100, 0.0, 30.0)
    heading = angles_from_start(seconds, turned(turn, 2, np.array(up, float)))
    tilt = angles_from_start(seconds, turned(turn, 0, np.array(up, float)))
    place = {name: i for i, name in enumerate(ANGLE_COLUMNS)}
    np.testing.assert_allclose(heading[-1, place['heading']], 30.0)
    np.testing.assert_allclose(heading[-1, place['inclination']], 0.0, atol=1e-9)
    np.testing.assert_allclose(tilt[-1, place['inclination']], 30.0)
    np.testing.assert_allclose(tilt[-1, place['heading']], 0.0, atol=1e-9)
    for angles in (heading, tilt):
        np.testing.assert_allclose(angles[-1, place['rotation']], 30.0)


def test_rows_without_an_attitude_do_not_count() -> None:
    seconds = np.arange(0.0, 200.0)
    q = turned(np.zeros(200), 2, np.array([0.0, 0.0, 0.0, 1.0]))
    q[:5] = np.nan
    angles = angles_from_start(seconds, q)
    assert np.isnan(angles[:5]).all()
    assert angle_statistics(angles, None)[0]['std']['yaw'] == 0.0
    nothing = angles_from_start(seconds, np.full((200, 4), np.nan))
    assert angle_statistics(nothing, None) == [{'part': 'run'}]


def test_spread_across_180_degrees_is_that_of_the_angle() -> None:
    rng = np.random.default_rng(4)
    yaw = 178.0 + rng.normal(0.0, 3.0, 20_000)
    angles = np.tile(((yaw + 180.0) % 360.0 - 180.0)[:, None], (1, len(ANGLE_COLUMNS)))
    found = angle_statistics(angles, np.repeat([1, 2], 10_000))
    assert [part['part'] for part in found] == ['run', 'R1', 'R2']
    assert found[0]['mean']['yaw'] == pytest.approx(178.0, abs=0.1)
    assert found[0]['std']['yaw'] == pytest.approx(3.0, rel=0.02)


def test_the_magnetometers_share_is_the_difference(run) -> None:
    raw = upsample(run(cycles=1))
    # The field's slope is the only error here: compensating it alone is compensating all.
    truth = np.tile(raw.magnetic_field[:1], (len(raw), 1))
    raw = replace(raw, angular_velocity=np.zeros((len(raw), 3)))
    compensated = replace(raw, magnetic_field=truth)
    spread = {
        (a.filter, a.data): a.statistics[0]['std']['rotation']
        for a in estimate_attitudes(
            {
                'raw': raw,
                'magnetometer compensated': replace(raw, magnetic_field=truth),
                'compensated': compensated,
            },
            every=10,
        )
    }
    for name in ('complementary', 'ahrs'):
        assert spread[name, 'magnetometer compensated'] == spread[name, 'compensated']
        assert spread[name, 'raw'] > 3.0 * spread[name, 'compensated']


def test_the_larger_filter_has_the_larger_state() -> None:
    assert state_bytes('ahrs') > state_bytes('complementary') > 50
