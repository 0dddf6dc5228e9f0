# SPDX-License-Identifier: Apache-2.0
"""Histories of bounded length: nothing new is lost, and a second is all its samples."""

import numpy as np
import pytest
from imu_recording.bags.decoding.cdr import encode_messages
from imu_recording.logging_contract import IMU
from imu_recording.recording import SECOND_NS
from imu_workbench.web.live.topic_history import PerSecond, Recent, Rows, decoded

from .heard import GRAVITY, TRUE_RATE, imu

START = 1_800_000_000 * SECOND_NS


def stamps(seconds: float, rate_hz: float) -> np.ndarray:
    return START + (np.arange(round(seconds * rate_hz)) * SECOND_NS / rate_hz).astype(np.int64)


@pytest.mark.parametrize('batch', [1, 7, 100])
def test_a_ring_holds_the_newest_whatever_the_batches(batch: int) -> None:
    ring = Recent(1, capacity=64)
    for first in range(0, 300, batch):
        stamp = np.arange(first, min(first + batch, 300))
        ring.add(Rows(stamp, stamp[:, None] * 2.0))
    rows = ring.since(250)
    np.testing.assert_array_equal(rows.stamp, np.arange(250, 300))
    np.testing.assert_array_equal(rows.values[:, 0], np.arange(250, 300) * 2.0)


def test_a_second_has_the_mean_and_spread_of_all_its_samples() -> None:
    random = np.random.default_rng(5)
    values = 9.8e3 + random.normal(0, 1e-3, (1000, 2))
    values[::50, 1] = np.nan
    stamp = stamps(10, 100)
    history = PerSecond(2)
    for part in np.array_split(np.arange(1000), 37):
        history.add(Rows(stamp[part], values[part]))
    expected = values.reshape(10, 100, 2)
    np.testing.assert_allclose(history.means()[1], np.nanmean(expected, 1), rtol=1e-12)
    np.testing.assert_allclose(history.deviations(), np.nanstd(expected, 1), rtol=1e-4)


def test_a_full_history_lets_go_of_the_oldest() -> None:
    history = PerSecond(1, capacity=100)
    stamp = stamps(250, 1)
    history.add(Rows(stamp, np.arange(250.0)[:, None]))
    second, means = history.means()
    assert 90 <= len(second) <= 100
    assert history.oldest == second[0]
    np.testing.assert_array_equal(second, np.arange(second[0], stamp[-1] // SECOND_NS + 1))
    np.testing.assert_array_equal(means[:, 0], second - stamp[0] // SECOND_NS)
    _, part = history.means(second[5], second[9])
    np.testing.assert_array_equal(part, means[5:9])


def test_bytes_become_the_numbers_that_ros_serialised() -> None:
    stamp = stamps(1, 4)
    messages = imu(stamp[:2], TRUE_RATE, GRAVITY, 'a') + imu(
        stamp[2:], -TRUE_RATE, GRAVITY, 'bcdefghi'
    )
    rows, unreadable = decoded(IMU, [*messages, b'\x00\x01\x00\x00', b''])
    assert unreadable == 2
    np.testing.assert_array_equal(rows.stamp, stamp)
    np.testing.assert_allclose(rows.values[:, 13:16], TRUE_RATE * [[1], [1], [-1], [-1]])
    np.testing.assert_allclose(rows.values[:, 25:28], np.broadcast_to(GRAVITY, (4, 3)))


def test_what_a_message_does_not_report_is_not_a_number() -> None:
    message = encode_messages(
        IMU, stamps(1, 1), 'imu', (np.zeros((1, 3)), np.ones((1, 3))), {16: -1.0}
    )
    rows, _ = decoded(IMU, [message[0].tobytes()])
    assert np.isnan(rows.values[0, 13:16]).all()
    np.testing.assert_array_equal(rows.values[0, 25:28], 1.0)
