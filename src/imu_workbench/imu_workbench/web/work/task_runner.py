# SPDX-License-Identifier: Apache-2.0
"""Runs a server's tasks in workers: every tab sees them under way, and hears what failed."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any

from imu_workbench.web.work.jobs import JobCancelled, JobError
from imu_workbench.web.work.notices import Notices
from imu_workbench.web.work.result_cache import ResultCache


class TaskRunner:
    """Tasks of a server, each computed once."""

    def __init__(self, cache: ResultCache, notices: Notices) -> None:
        self.cache, self.notices = cache, notices
        self.background: set[asyncio.Task[Any]] = set()
        """Tasks that nobody waits for."""

    def begin(self, work: Any) -> None:
        """Start work that nobody waits for."""
        task = asyncio.ensure_future(work)
        self.background.add(task)
        task.add_done_callback(self.background.discard)

    async def run(
        self, about: str, key: Any, function: Callable[..., Any], *arguments: Any
    ) -> Any:
        """Return the value of a task; None where it was cancelled or failed, which is said.

        `about`: device and version it is for, or the bag.
        """
        try:
            show = partial(self.notices.work, about=about)
            return await self.cache.compute(show, key, function, *arguments)
        except JobError as error:
            self.notices.say(self.plain(str(error)))
        except JobCancelled:
            self.notices.say(f'{about}: cancelled', 'info')
        return None

    def plain(self, text: str) -> str:
        """Return a message without the names of this server's own folders."""
        return text.replace(f'{self.cache.folder}/', '')
