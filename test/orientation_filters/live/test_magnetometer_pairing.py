# SPDX-License-Identifier: Apache-2.0
"""Every IMU sample comes out once, in order, with the field of its stamp, however they arrive."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_recording.ros.messages import ImuSample, MagneticSample
from orientation_filters.live.magnetometer_pairing import MagnetometerPairing

MS = 1_000_000


def imu(ms: int) -> ImuSample:
    return ImuSample(ms * MS, (0.0, 0.0, 0.0), (0.0, 0.0, 9.81))


def field(ms: int) -> MagneticSample:
    return MagneticSample(ms * MS, (0.0, 2e-5, -4e-5))


def feed(pairing: MagnetometerPairing, messages: list) -> list:
    pairs = []
    for message in messages:
        is_imu = isinstance(message, ImuSample)
        pairs += pairing.add_imu(message) if is_imu else pairing.add_field(message)
    return pairs + pairing.flush()


@given(st.lists(st.booleans(), min_size=30, max_size=60))
@settings(max_examples=50, deadline=None)
def test_equal_stamps_meet_in_either_order(imu_first: list[bool]) -> None:
    messages: list = []
    for k, first in enumerate(imu_first):
        pair = [imu(10 * k), field(10 * k)]
        messages += pair if first else pair[::-1]
    pairs = feed(MagnetometerPairing(), messages)
    assert [p[0].stamp for p in pairs] == [10 * k * MS for k in range(len(imu_first))]
    assert all(m is not None and m.stamp == s.stamp for s, m in pairs)


def test_a_slower_magnetometer_delays_nothing_but_its_own_stamps() -> None:
    pairing = MagnetometerPairing()
    for k in range(100):
        released = pairing.add_imu(imu(10 * k))
        if k % 10 == 0:
            released += pairing.add_field(field(10 * k))
        if k > 20:
            assert [s.stamp for s, _ in released] == [10 * k * MS]
            assert (released[0][1] is not None) == (k % 10 == 0)


def test_a_field_between_stamps_goes_to_the_next_row() -> None:
    messages = [m for k in range(20) for m in (field(10 * k - 3), imu(10 * k))]
    pairs = feed(MagnetometerPairing(), messages)
    assert [m.stamp for _, m in pairs] == [(10 * k - 3) * MS for k in range(20)]


def test_a_dead_magnetometer_does_not_hold_samples_back() -> None:
    pairing = MagnetometerPairing()
    feed(pairing, [m for k in range(20) for m in (imu(10 * k), field(10 * k))])
    late = 0
    for k in range(20, 60):
        late += len(pairing.add_imu(imu(10 * k))) == 0
    assert late <= 2


def test_without_any_magnetometer_the_first_samples_wait_a_tenth_of_a_second() -> None:
    pairing = MagnetometerPairing()
    counts = [len(pairing.add_imu(imu(10 * k))) for k in range(30)]
    assert counts[:10] == [0] * 10
    assert counts[10] == 11
    assert counts[11:] == [1] * 19


def test_a_looping_bag_starts_over() -> None:
    loop = [m for k in range(50) for m in (imu(10 * k), field(10 * k))]
    pairs = feed(MagnetometerPairing(), loop + loop)
    assert len(pairs) == 100
    assert all(m is not None and m.stamp == s.stamp for s, m in pairs)


@given(st.lists(st.booleans(), min_size=30, max_size=60))
@settings(max_examples=50, deadline=None)
def test_in_order_nothing_waits_and_the_pairs_are_the_same(measured: list[bool]) -> None:
    messages: list = []
    for k, has_field in enumerate([True, *measured]):
        messages += [field(10 * k)] if has_field else []
        messages.append(imu(10 * k))
    pairing = MagnetometerPairing(in_order=True)
    at_once = []
    for message in messages:
        is_imu = isinstance(message, ImuSample)
        found = pairing.add_imu(message) if is_imu else pairing.add_field(message)
        assert len(found) == is_imu
        at_once += found
    assert at_once == feed(MagnetometerPairing(), messages)
