# SPDX-License-Identifier: Apache-2.0
"""The queue between reader and publisher keeps the order and counts the samples it drops."""

import threading

from imu_driver.board.sample import Sample
from imu_driver.driver import QUEUE_CAPACITY, SampleQueue

DEADLINE = 120.0


def samples(first: int, count: int) -> list[Sample]:
    zero = (0.0, 0.0, 0.0)
    return [Sample(stamp, zero, zero, None, None) for stamp in range(first, first + count)]


def test_a_live_source_goes_on_when_the_publisher_hangs() -> None:
    free, hanging = threading.Event(), threading.Event()
    published: list[Sample] = []

    def publish(batch: list[Sample]) -> None:
        hanging.set()
        assert free.wait(DEADLINE)
        published.extend(batch)

    queue = SampleQueue(publish)
    queue.start()
    queue.put(samples(0, 1))
    assert hanging.wait(DEADLINE)
    for first in range(1, 3 * QUEUE_CAPACITY, 100):
        queue.put(samples(first, 100))
    assert 0.9 < queue.fill <= 1.0
    free.set()
    queue.stop()
    stamps = [sample.stamp for sample in published]
    assert stamps == sorted(stamps)
    assert stamps[-1] == 3 * QUEUE_CAPACITY
    assert len(stamps) + queue.overflowed == 3 * QUEUE_CAPACITY + 1
    assert queue.fullest <= QUEUE_CAPACITY


def test_a_recording_waits_for_the_publisher() -> None:
    published: list[Sample] = []
    queue = SampleQueue(published.extend)
    queue.start()
    for first in range(0, 5 * QUEUE_CAPACITY, 1000):
        queue.put_when_room(samples(first, 1000))
    queue.stop()
    assert len(published) == 5 * QUEUE_CAPACITY
    assert queue.overflowed == 0
