# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import asyncio
import operator
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest
from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.case.tasks import effects_task
from imu_workbench.web.jobs import Job, JobCancelled, JobError, LockWait
from imu_workbench.web.result_cache import ResultCache
from thermal_comp.effects import EFFECTS

ENDLESS = partial(operator.contains, range(10**18))
"""Looks for the function that tells the progress among all these numbers."""


def test_a_job_tells_its_progress_and_its_result():
    job = Job(effects_task, [])
    assert set(job.wait()) == set(EFFECTS)
    assert job.progress == 'checking the effect file'


def test_mistakes_are_one_line_and_bugs_say_that_they_are():
    with pytest.raises(JobError, match=r'^nowhere\.py: no such file$'):
        Job(effects_task, [Path('nowhere.py')]).wait()
    with pytest.raises(JobError, match='bug in the workbench'):
        Job(effects_task, 7).wait()


def test_a_job_can_be_stopped():
    job = Job(ENDLESS)
    job.cancel()
    with pytest.raises(JobCancelled):
        job.wait()


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
    assert sorted(shown) == ['Job', 'LockWait']


def test_who_waits_for_another_tab_can_give_up():
    async def give_up() -> bool:
        lock, waiting = asyncio.Lock(), LockWait()
        await lock.acquire()
        waiting.cancel()
        with pytest.raises(JobCancelled):
            await waiting.acquire(lock)
        lock.release()
        return lock.locked()

    assert asyncio.run(give_up()) is False
