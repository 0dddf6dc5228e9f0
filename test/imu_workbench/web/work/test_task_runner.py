# SPDX-License-Identifier: Apache-2.0
"""What a task fails with is said once, in words for the user; what is done is shown."""

from __future__ import annotations

import asyncio

from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.case.tasks import effects_task
from imu_workbench.web.work.notices import Notices
from imu_workbench.web.work.result_cache import ResultCache
from imu_workbench.web.work.task_runner import TaskRunner


def test_a_task_that_fails_is_said_without_the_folders_of_the_server(tmp_path):
    notices, shown = Notices(), set()
    runner = TaskRunner(ResultCache(BagRoot(tmp_path), tmp_path), notices)
    notices.listen(lambda: shown.update(job.about for job in notices.jobs))
    answer = asyncio.run(runner.run('dut2 v1', 'key', effects_task, [tmp_path / 'dip.py']))
    assert answer is None
    assert [message.text for message in notices.messages] == ['dip.py: no such file']
    assert shown == {'dut2 v1'}
    assert notices.jobs == []
