# SPDX-License-Identifier: Apache-2.0
"""A periodic thread: it calls, it stops, and it reports the step that raises."""

import threading

import pytest
from chamber_profile.periodic_thread import PeriodicThread


def test_it_calls_again_and_again_until_it_is_stopped() -> None:
    called, enough = [], threading.Event()

    def step() -> None:
        called.append(1)
        if len(called) >= 5:
            enough.set()

    thread = PeriodicThread(step, 0.001, lambda: None)
    assert enough.wait(10.0)
    thread.stop()
    count = len(called)
    assert not thread._thread.is_alive()
    assert len(called) == count


@pytest.mark.filterwarnings('ignore::pytest.PytestUnhandledThreadExceptionWarning')
def test_a_step_that_raises_is_reported_and_ends_the_thread() -> None:
    failed = threading.Event()

    def step() -> None:
        raise RuntimeError('unexpected')

    thread = PeriodicThread(step, 0.001, failed.set)
    assert failed.wait(10.0)
    thread.stop()
    assert not thread._thread.is_alive()
