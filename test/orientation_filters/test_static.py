# SPDX-License-Identifier: Apache-2.0
"""At rest, whatever the attitude, the filters find it and the bias, and a jam at its limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from orientation_filters.ahrs.filter import initial_state, update
from orientation_filters.filters import FILTERS, filter_parameters, run_filter
from orientation_filters.result import JAMMED, SIX_AXIS
from orientation_filters.rotation.arrays import (
    conjugate,
    enu_from,
    inclination_angle,
    multiply,
    rotate,
    rotation_angle,
)
from orientation_filters.sample_checks import Sample

from .recordings import random_attitude, rest, world_vectors


@pytest.mark.parametrize('world_frame', ['enu', 'ned'])
def test_ahrs_finds_random_attitudes_and_the_bias(world_frame: str) -> None:
    error, bias_60, bias_300 = [], [], []
    for seed in range(100):
        truth = random_attitude(seed)
        bias = np.random.default_rng(1000 + seed).normal(size=3) * np.radians(0.3)
        recording = rest(truth, seed=seed, seconds=300, bias=bias, world_frame=world_frame)
        result = run_filter('ahrs', recording, world_frame=world_frame)
        error.append(rotation_angle(multiply(conjugate(truth), result.orientation[-1])))
        bias_60 += np.abs(result.bias[5999] - bias).tolist()
        bias_300 += np.abs(result.bias[-1] - bias).tolist()
    assert np.degrees(np.percentile(error, 95)) <= 0.3
    assert np.degrees(np.percentile(bias_60, 95)) <= 0.06
    assert np.degrees(np.sqrt(np.mean(np.square(bias_300)))) <= 0.025


@pytest.mark.parametrize('world_frame', ['enu', 'ned', 'nwu'])
@pytest.mark.parametrize('name', ['complementary', 'ahrs'])
@pytest.mark.parametrize('preset', ['paper', 'robust'])
def test_both_filters_hold_the_attitude_in_both_frames(
    name: str, world_frame: str, preset: str
) -> None:
    for seed in range(10):
        truth = random_attitude(seed)
        recording = rest(truth, seed=seed, noise=0.01, world_frame=world_frame, seconds=20)
        result = run_filter(name, recording, world_frame=world_frame, preset=preset)
        assert np.degrees(rotation_angle(multiply(conjugate(truth), result.orientation[-1]))) < 0.1
        assert np.all(np.linalg.eigvalsh(result.covariance[-1]) > 0)


@pytest.mark.parametrize('name', FILTERS)
@pytest.mark.parametrize('world_frame', ['ned', 'nwu'])
def test_every_world_frame_tells_the_same_attitude(name: str, world_frame: str) -> None:
    recording = rest(random_attitude(3), seed=3, seconds=20.0, noise=0.01)
    options = {'magnetic_declination': 0.2}
    enu = run_filter(name, recording, **options).orientation[-1]
    other = run_filter(name, recording, world_frame=world_frame, **options).orientation[-1]
    apart = rotation_angle(multiply(conjugate(enu), enu_from(world_frame, other)))
    assert np.degrees(apart) < 1e-3


@pytest.mark.parametrize('name', FILTERS)
@pytest.mark.parametrize('preset', ['paper', 'robust'])
def test_a_heading_that_nothing_shows_is_claimed_by_no_covariance(name: str, preset: str) -> None:
    recording = rest(random_attitude(1), seed=1, seconds=20.0)
    result = run_filter(name, recording, preset=preset, use_magnetometer=False)
    assert np.degrees(np.sqrt(result.covariance[-1, 2, 2])) > 90.0


def test_six_axes_give_inclination_and_the_horizontal_bias() -> None:
    horizontal: list[float] = []
    for seed in range(20):
        truth = random_attitude(seed)
        bias = np.random.default_rng(1000 + seed).normal(size=3) * np.radians(0.3)
        recording = rest(truth, seed=seed, bias=bias, seconds=120)
        result = run_filter('ahrs', recording, use_magnetometer=False)
        tilt = inclination_angle(multiply(result.orientation[-1], conjugate(truth)))
        assert np.degrees(tilt) < 0.3
        horizontal += np.abs(rotate(truth, result.bias[-1] - bias)[:2]).tolist()
        assert np.all((result.flags & SIX_AXIS != 0) | (np.arange(len(result.flags)) == 0))
    assert np.degrees(np.percentile(horizontal, 95)) < 0.06


def test_jam_trips_exactly_at_twice_the_field() -> None:
    params = filter_parameters('ahrs').kernel_params()
    truth = random_attitude(3)
    force, field = (rotate(conjugate(truth), v) for v in world_vectors('enu'))
    state, stamp = initial_state(), 0
    for _ in range(2000):
        stamp += 10_000_000
        sample = Sample(stamp, (0.0, 0.0, 0.0), tuple(force), tuple(field))
        state, estimate = update(state, params, sample)
    assert not estimate.flags & JAMMED
    lengths = []
    for extra in np.linspace(0.0, 400e-6, 801):
        seen = tuple(field + np.array([extra, 0.0, 0.0]))
        sample = Sample(stamp + 10_000_000, (0.0, 0.0, 0.0), tuple(force), seen)
        after, estimate = update(state, params, sample)
        length = np.linalg.norm(after.magnetic_disturbance)
        lengths.append(length)
        assert bool(estimate.flags & JAMMED) == (length > 2 * params.field_strength)
    assert min(lengths) < 2 * params.field_strength < max(lengths)


def test_declination_turns_the_heading_by_itself() -> None:
    recording = rest(random_attitude(5), seed=5, seconds=10)
    east = np.radians(7.0)
    for name in ('complementary', 'ahrs'):
        plain = run_filter(name, recording).orientation[-1]
        turned = run_filter(name, recording, magnetic_declination=east).orientation[-1]
        between = multiply(turned, conjugate(plain))
        expected = [0.0, 0.0, np.sin(-east / 2), np.cos(east / 2)]
        np.testing.assert_allclose(between, expected, atol=1e-6)


def test_mount_gives_the_attitude_of_the_body() -> None:
    truth, mount = random_attitude(6), random_attitude(7)
    recording = rest(truth, seed=6, noise=0.01, seconds=20)
    for name in ('complementary', 'ahrs'):
        result = run_filter(name, recording, mount=mount.tolist())
        body = multiply(truth, conjugate(mount))
        assert np.degrees(rotation_angle(multiply(conjugate(body), result.orientation[-1]))) < 0.1


def test_a_slower_magnetometer_holds_the_heading() -> None:
    truth = random_attitude(8)
    recording = rest(truth, seed=8, bias=np.radians([0.2, 0.2, 0.2]), seconds=120)
    field = recording.magnetic_field.copy()
    field[np.arange(len(field)) % 10 != 0] = np.nan
    slow = replace(recording, magnetic_field=field)
    for name in ('complementary', 'ahrs'):
        result = run_filter(name, slow)
        assert not np.any(result.flags & SIX_AXIS)
        error = rotation_angle(multiply(conjugate(truth), result.orientation[-1000:]))
        assert np.degrees(np.median(error)) < (2.0 if name == 'ahrs' else 0.5)
