# SPDX-License-Identifier: Apache-2.0
"""Work in a process of its own: result, error, end, and the time it takes."""

from __future__ import annotations

import asyncio
import operator
from functools import partial
from pathlib import Path

import pytest
from imu_workbench.web.case.tasks import effects_task
from imu_workbench.web.work import jobs
from imu_workbench.web.work.jobs import (
    Job,
    JobCancelled,
    JobError,
    LockWait,
    expected_seconds,
    time_left,
)
from thermal_comp.effects import EFFECTS

ENDLESS = partial(operator.contains, range(10**18))
"""Looks for the function that tells the progress among all these numbers."""


def test_a_job_tells_its_progress_and_its_result():
    job = Job(effects_task, [])
    assert set(job.wait()) == set(EFFECTS)
    assert job.progress == 'checking the file'


def test_the_time_left_follows_from_the_share_that_is_done():
    job = Job(effects_task, [])
    job.began, job._foretold, job.expected_end = 100.0, 40.0, 140.0
    assert time_left(job, 139.8) == 'about 1 s left'
    assert time_left(job, 142.0) == '42 s so far'
    job.hear('a quarter is done: 80 s in all by this measure', 0.25, 120.0)
    assert time_left(job, 120.0) == 'about 30 s left'
    job.hear('which share, nobody knows', 0.0, 130.0)
    assert time_left(job, 130.0) == 'about 20 s left'
    job.hear('most is done: 80 s again', 0.75, 160.0)
    assert time_left(job, 160.0) == 'about 10 s left'
    job.wait()


def test_mistakes_are_one_line_and_bugs_say_that_they_are():
    with pytest.raises(JobError, match=r'^nowhere\.py: no such file$'):
        Job(effects_task, [Path('nowhere.py')]).wait()
    with pytest.raises(JobError, match='bug in the workbench'):
        Job(effects_task, 7).wait()


def test_a_short_task_that_was_slow_says_little_of_how_long_others_take(monkeypatch):
    monkeypatch.setattr(
        jobs, 'EXPECTED_AND_SPENT_S', {'': (20.0, 20.0), 'diagnose_task': (10.0, 10.0)}
    )
    Job(effects_task, []).wait()
    foretold, took = jobs.EXPECTED_AND_SPENT_S['effects_task']
    assert jobs.EXPECTED_AND_SPENT_S[''] == (20.0 + foretold, 20.0 + took)
    assert expected_seconds('effects_task', 0) == pytest.approx(took)
    assert expected_seconds('diagnose_task', 0) == pytest.approx(9.0)
    others = (20.0 + took) / (20.0 + foretold)
    assert expected_seconds('report_task', 0) == pytest.approx(15.0 * others)


def test_a_job_can_be_stopped():
    job = Job(ENDLESS)
    job.cancel()
    with pytest.raises(JobCancelled):
        job.wait()


def test_who_waits_for_another_tab_can_give_up():
    async def give_up() -> bool:
        lock, waiting = asyncio.Lock(), LockWait('a.mcap waits to be read')
        await lock.acquire()
        waiting.cancel()
        with pytest.raises(JobCancelled):
            await waiting.acquire(lock)
        lock.release()
        return lock.locked()

    assert asyncio.run(give_up()) is False
