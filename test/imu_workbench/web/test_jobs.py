# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import asyncio
import operator
from functools import partial
from pathlib import Path

import pytest
from imu_workbench.web.case.tasks import effects_task
from imu_workbench.web.jobs import Job, JobCancelled, JobError, LockWait
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
