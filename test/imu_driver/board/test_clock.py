# SPDX-License-Identifier: Apache-2.0
"""Stamps against true sampling times under delays of USB and schedulers and crystal drift."""

import numpy as np
import pytest
from imu_driver.board.clock import DeviceClock
from imu_recording.recording import FloatArray

EPOCH = 1_700_000_000_000_000_000
RATE = 50.0


def crystal(time: FloatArray, period: float = 3600.0) -> FloatArray:
    """Device time of a crystal that wanders 35 ± 8 ppm."""
    phase = 2.0 * np.pi * time / period
    return time * (1.0 + 35e-6) + 8e-6 * period / (2.0 * np.pi) * (1.0 - np.cos(phase))


def arrivals(time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """When samples arrive: exponential jitter, 1 ms frames of USB, stalls of 20 ms."""
    arrival = time + 0.3e-3 + rng.exponential(0.5e-3, len(time))
    arrival = np.ceil(arrival * 1e3) * 1e-3
    for stall in rng.uniform(0.0, time[-1], len(time) // 200):
        arrival = np.where((arrival > stall) & (arrival < stall + 0.02), stall + 0.02, arrival)
    return np.maximum.accumulate(arrival)


def run(clock: DeviceClock, device: FloatArray, arrival: FloatArray, first: int = 0) -> FloatArray:
    """Stamps [s] since EPOCH."""
    ticks = (np.floor(device * 1e6).astype(np.int64) + first) % (1 << 32)
    stamps = [
        clock.stamp(tick, EPOCH + ns)
        for tick, ns in zip(ticks.tolist(), (arrival * 1e9).astype(np.int64).tolist(), strict=True)
    ]
    assert (np.diff(stamps) > 0).all()
    return (np.array(stamps) - EPOCH) * 1e-9


def test_an_hour_of_a_wandering_crystal() -> None:
    rng = np.random.default_rng(2)
    time = np.arange(int(3600 * RATE)) / RATE + rng.uniform(0.0, 1e-3)
    arrival = arrivals(time, rng)
    clock = DeviceClock(latency=0.3e-3)
    error = run(clock, crystal(time), arrival, first=(1 << 32) - 100_000_000) - time
    assert clock.wraps == 1
    assert clock.resets == clock.steps == 0
    assert error.std() < 50e-6
    assert 0.0 <= error.mean() < 1e-3, 'what is left is the shortest delay: one USB frame at most'
    assert (arrival - time).std() > 10 * error.std()
    assert 20 < clock.skew_ppm < 50


def test_a_ceramic_resonator() -> None:
    rng = np.random.default_rng(4)
    time = np.arange(0.0, 300.0, 0.0101)
    clock = DeviceClock()
    error = run(clock, time * (1.0 - 4e-3), arrivals(time, rng)) - time
    assert clock.skew_ppm == pytest.approx(-4000.0, rel=0.05)
    assert error[time > 10.0].std() < 100e-6


def test_a_restart_begins_anew() -> None:
    clock = DeviceClock()
    time = np.arange(0.0, 30.0, 0.01)
    device = np.where(time < 15.0, time + 100.0, time - 15.0)
    stamps = run(clock, device, time + 1e-3)
    assert clock.resets == 1
    np.testing.assert_allclose(stamps, time + 1e-3, atol=2e-6)


def test_long_silence_with_whole_turns_of_the_counter() -> None:
    turn = (1 << 32) * 1e-6
    time = np.concatenate([np.arange(0.0, 20.0, 0.01), 2.3 * turn + np.arange(0.0, 20.0, 0.01)])
    clock = DeviceClock()
    stamps = run(clock, time, time + 1e-3)
    assert clock.wraps == 2
    assert clock.resets == 0
    np.testing.assert_allclose(stamps, time + 1e-3, atol=2e-6)


def test_a_host_clock_that_was_set() -> None:
    time = np.arange(0.0, 60.0, 0.01)
    clock = DeviceClock()
    forward = np.where(time < 30.0, time, time + 5.0)
    stamps = run(clock, time, forward)
    late = time > 34.0
    assert clock.steps == 1
    np.testing.assert_allclose(stamps[late], forward[late], atol=2e-6)
    clock = DeviceClock()
    stamp = [clock.stamp(round(t * 1e6), EPOCH + round(t * 1e9)) for t in (1.0, 2.0)]
    stamp.append(clock.stamp(3_000_000, EPOCH - 7_000_000_000))
    assert stamp[-1] == EPOCH - 7_000_000_000
    assert clock.steps == 1


def test_a_line_that_backs_up_for_long_is_no_set_clock() -> None:
    time = np.arange(0.0, 60.0, 0.01)
    backlog = np.interp(time, [0.0, 20.0, 24.0, 40.0, 40.5], [0.0, 0.0, 3.0, 3.0, 0.0])
    clock = DeviceClock()
    arrival = np.maximum.accumulate(time + 1e-3 + backlog)
    stamps = run(clock, time, arrival)
    assert clock.steps == 0
    np.testing.assert_allclose(stamps, time + 1e-3, atol=2e-6)


def test_stamps_do_not_lie_after_arrival() -> None:
    rng = np.random.default_rng(3)
    time = np.arange(0.0, 20.0, 0.01)
    arrival = arrivals(time, rng)
    assert (run(DeviceClock(), time, arrival) <= arrival + 2e-9).all()


def test_a_backlog_is_spread_over_the_time_it_was_measured() -> None:
    clock = DeviceClock()
    arrival = EPOCH + 2_000_000_000
    seen = [clock.observe(round(time * 1e6), arrival) for time in np.arange(0.0, 2.0, 0.01)]
    stamps = (np.array(clock.settle(seen)) - arrival) * 1e-9
    np.testing.assert_allclose(stamps, np.arange(0.0, 2.0, 0.01) - 1.99, atol=1e-8)
