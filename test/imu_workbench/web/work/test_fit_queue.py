# SPDX-License-Identifier: Apache-2.0
"""Fits in their queue: order, results, cancelled and failed ones."""

from __future__ import annotations

import asyncio

from imu_workbench.web.case.tasks import Change
from imu_workbench.web.work.fit_queue import FitQueue, QueuedFit


def run(script) -> list[str]:
    """Run a script over a queue whose fits wait for a gate; return what was fitted on what."""
    told: list[str] = []

    async def play() -> None:
        gate = asyncio.Event()
        versions = iter(('v2', 'v3', 'v4'))

        async def fit(one: QueuedFit) -> None:
            await gate.wait()
            told.append(f'{one.change.effect} on {one.start}')
            if one.change.effect == 'failing':
                one.state = 'failed'
            else:
                one.state, one.result = 'done', next(versions)

        queue = FitQueue(fit, lambda: None)
        await script(queue, gate)
        while queue.fits:
            await asyncio.sleep(0)

    asyncio.run(play())
    return told


def test_a_second_wish_follows_the_first():
    async def script(queue: FitQueue, gate: asyncio.Event) -> None:
        queue.request('dut2', 'v1', Change('lag'), 'tab')
        second = queue.request('dut2', 'v1', Change('icing'), 'tab')
        assert [fit.state for fit in queue.fits] == ['waiting', 'waiting']
        assert 'after “add lag”' in second.told
        gate.set()

    assert run(script) == ['lag on v1', 'icing on v2']


def test_tabs_do_not_build_on_each_other_unasked():
    async def script(queue: FitQueue, gate: asyncio.Event) -> None:
        queue.request('dut2', 'v1', Change('lag'), 'one')
        queue.request('dut2', 'v1', Change('icing'), 'other')
        gate.set()

    assert run(script) == ['lag on v1', 'icing on v1']


def test_what_follows_a_wish_that_was_cancelled_or_failed_starts_where_that_one_did():
    async def script(queue: FitQueue, gate: asyncio.Event) -> None:
        queue.request('dut2', 'v1', Change('failing'), 'tab')
        dropped = queue.request('dut2', 'v1', Change('dropped'), 'tab')
        queue.request('dut2', 'v1', Change('icing'), 'tab')
        queue.cancel(dropped)
        assert dropped.state == 'cancelled'
        gate.set()

    assert run(script) == ['failing on v1', 'icing on v1']


def test_who_goes_elsewhere_is_not_taken_to_a_fit_that_is_done():
    async def script(queue: FitQueue, gate: asyncio.Event) -> None:
        gate.set()
        own, other = (queue.request('dut2', 'v1', Change('lag'), tab) for tab in ('one', 'other'))
        while queue.fits:
            await asyncio.sleep(0)
        assert queue.finished == [own, other]
        queue.forget('one')
        assert queue.finished == [other]

    run(script)
