# SPDX-License-Identifier: Apache-2.0
"""Results are computed once for all who ask."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.case.tasks import effects_task
from imu_workbench.web.work.jobs import JobCancelled
from imu_workbench.web.work.result_cache import ResultCache, file_key


def test_tabs_that_ask_for_the_same_share_one_computation(tmp_path):
    shown: list[str] = []

    @contextmanager
    def show(work) -> Iterator[None]:
        shown.append(type(work).__name__)
        yield

    async def ask_twice() -> list[object]:
        cache = ResultCache(BagRoot(tmp_path), tmp_path)
        asked = [cache.compute(show, 'key', effects_task, []) for _ in range(2)]
        return await asyncio.gather(*asked)

    one, other = asyncio.run(ask_twice())
    assert one is other
    assert shown == ['Job']


def test_who_cancels_work_cancels_it_for_all_who_asked(tmp_path):
    @contextmanager
    def cancelled(work) -> Iterator[None]:
        work.cancel()
        yield

    async def ask_twice() -> list[object]:
        cache = ResultCache(BagRoot(tmp_path), tmp_path)
        asked = [cache.compute(cancelled, 'key', effects_task, []) for _ in range(2)]
        return await asyncio.gather(*asked, return_exceptions=True)

    assert [type(answer) for answer in asyncio.run(ask_twice())] == [JobCancelled] * 2


def test_a_bag_that_changes_has_another_key(tmp_path: Path):
    bag = tmp_path / 'bag'
    bag.mkdir()
    (bag / 'a.mcap').write_bytes(b'12345')
    before = file_key(bag)
    assert file_key(bag) == before
    (bag / 'b.mcap').write_bytes(b'1')
    assert file_key(bag) != before
