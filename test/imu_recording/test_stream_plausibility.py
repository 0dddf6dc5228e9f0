# SPDX-License-Identifier: Apache-2.0
"""A live stream checked like a recording: its unit, single damage, a clock that stands."""

from __future__ import annotations

import numpy as np
from imu_recording.ros.messages import ImuSample
from imu_recording.stream_plausibility import StreamCheck

PERIOD = 10_000_000
G = 9.80665


def feed(check: StreamCheck, count: int, *, first: int = 0, scale: float = 1.0) -> None:
    """A board at rest; its accelerometer counts in `scale` per m/s²."""
    rng = np.random.default_rng(first)
    for k in range(first, first + count):
        rate = tuple(2e-3 * rng.standard_normal(3))
        force = tuple(scale * (0.01 * rng.standard_normal(3) + [0.0, 0.0, G]))
        assert check.on_imu(ImuSample(k * PERIOD, rate, force))


def test_si_units_meet_no_objection() -> None:
    check = StreamCheck()
    assert check.on_temperature(25.0)
    assert check.on_magnetic_field((2e-5, 0.0, -4e-5))
    feed(check, 2500)
    assert (check.objection, check.damaged) == ('', 0)


def test_an_accelerometer_in_g_is_told_early_and_forgiven_when_it_is_mended() -> None:
    check = StreamCheck()
    feed(check, 19, scale=1.0 / G)
    assert check.objection == ''
    feed(check, 1, first=19, scale=1.0 / G)
    assert 'linear_acceleration' in check.objection
    assert ' g' in check.objection
    feed(check, 3000, first=20)
    assert check.objection == ''


def test_single_impossible_values_are_refused_counted_and_forgotten() -> None:
    check = StreamCheck()
    feed(check, 10)
    assert not check.on_imu(ImuSample(10 * PERIOD, (71.0, 0.0, 0.0), (0.0, 0.0, G)))
    assert not check.on_temperature(300.0)
    assert not check.on_magnetic_field((0.0, 1.0, 0.0))
    assert check.on_temperature(float('nan'))
    assert check.damaged == 3
    assert check.damaged_now
    feed(check, 1002, first=11)
    assert not check.damaged_now


def test_a_clock_that_stands_is_told_and_one_that_starts_anew_is_not() -> None:
    check = StreamCheck()
    feed(check, 200)
    feed(check, 30)  # the clock is two seconds back: a new start
    assert check.newest == 29 * PERIOD
    assert check.objection == ''
    for _ in range(25):
        check.on_imu(ImuSample(29 * PERIOD, (0.0, 0.0, 0.0), (0.0, 0.0, G)))
    assert check.objection == f'the stamps stand still at {29 * PERIOD} ns'
