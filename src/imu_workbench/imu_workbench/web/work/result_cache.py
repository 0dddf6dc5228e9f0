# SPDX-License-Identifier: Apache-2.0
"""Results shared by all tabs of a server: bags read once, each result computed once."""

from __future__ import annotations

import asyncio
import hashlib
import itertools
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AbstractContextManager, asynccontextmanager
from pathlib import Path
from typing import Any

from imu_workbench.case import file_state
from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.case.stored_bag import StoredBag
from imu_workbench.web.work.jobs import Job, LockWait, Stoppable

BAGS_READ_AT_ONCE = 2
"""Number of bags that are read at the same time."""
LONG_BAG_BYTES = 50_000_000
"""Size of a bag from which it is read alone: reading takes a good part of the memory."""
MAX_RESULTS = 200
"""Results kept; the one unused for longest is dropped."""


class ResultCache:
    """Results by task and arguments; `folder` holds this server's temporary files."""

    def __init__(self, root: BagRoot, folder: Path) -> None:
        self.root = root
        self.folder = folder
        self._numbers = itertools.count()
        self._results: OrderedDict[Any, Any] = OrderedDict()
        self._under_way: dict[Any, asyncio.Future[Any]] = {}
        self._reading_long = asyncio.Lock()
        self._reading = asyncio.Semaphore(BAGS_READ_AT_ONCE)

    def fresh_path(self, suffix: str = '') -> Path:
        """Return an unused path in the temporary folder."""
        return self.folder / f'{next(self._numbers)}{suffix}'

    def prepared_path(self, bags: Sequence[StoredBag]) -> Path:
        """Return the file for the prepared runs of these bags."""
        names = '\n'.join(f'{bag.folder} {bag.run} {bag.device}' for bag in bags)
        return self.folder / f'{hashlib.sha256(names.encode()).hexdigest()[:16]}.runs'

    async def compute(
        self,
        show: Callable[[Stoppable], AbstractContextManager[None]],
        key: Any,
        function: Callable[..., Any],
        *arguments: Any,
    ) -> Any:
        """Return the function's value for this key, computed in a worker if it is not known.

        All who ask for the same at the same time share one job: its value or its error.
        """
        full = (function.__name__, key)
        if full in self._results:
            self._results.move_to_end(full)
            return self._results[full]
        if full not in self._under_way:

            async def done() -> Any:
                try:
                    job = Job(function, *arguments)
                    with show(job):
                        value = await job.result()
                finally:
                    del self._under_way[full]
                self._results[full] = value
                while len(self._results) > MAX_RESULTS:
                    self._results.popitem(last=False)
                return value

            self._under_way[full] = asyncio.ensure_future(done())
        return await asyncio.shield(self._under_way[full])

    @asynccontextmanager
    async def reading(
        self, path: Path, show: Callable[[Stoppable], AbstractContextManager[None]]
    ) -> AsyncIterator[None]:
        """Hold a place for reading a bag; long ones, which take memory, are read one by one."""
        long = file_key(path)[2] > LONG_BAG_BYTES
        lock = self._reading_long if long else self._reading
        if lock.locked():
            waiting = LockWait(f'{path.name} waits to be read')
            with show(waiting):
                await waiting.acquire(lock)
        else:
            await lock.acquire()
        try:
            yield
        finally:
            lock.release()


def file_key(path: Path) -> tuple[str, int, int]:
    """Return path, newest modification [ns] and size [bytes] of a bag: changes when it does."""
    return str(path), *file_state(path)
