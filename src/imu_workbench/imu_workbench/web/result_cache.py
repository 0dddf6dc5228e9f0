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

from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.case.stored_bag import StoredBag
from imu_workbench.web.jobs import Job, Stoppable, Waiting

KEPT = 200
"""Results remembered."""


class Library:
    """Bags below a root and results about them; `folder` is scratch space of this server."""

    def __init__(self, root: BagRoot, folder: Path) -> None:
        self.root = root
        self.folder = folder
        self._numbers = itertools.count()
        self._results: OrderedDict[Any, Any] = OrderedDict()
        self._locks: dict[Any, asyncio.Lock] = {}
        self.reading = asyncio.Lock()
        """Bags are read one at a time: a long one takes a good part of the memory."""

    def fresh_path(self, suffix: str = '') -> Path:
        """Return a path in the scratch space that nobody uses."""
        return self.folder / f'{next(self._numbers)}{suffix}'

    def prepared_path(self, bags: Sequence[StoredBag]) -> Path:
        """Return where the prepared runs of these bags are kept."""
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

        Tabs that ask for the same at the same time wait for one of them.
        """
        full = (function.__name__, key)
        async with self.alone(self._locks.setdefault(full, asyncio.Lock()), show):
            if full in self._results:
                self._results.move_to_end(full)
                return self._results[full]
            job = Job(function, *arguments)
            with show(job):
                value = await job.result()
            self._results[full] = value
            while len(self._results) > KEPT:
                self._results.popitem(last=False)
            return value

    @asynccontextmanager
    async def alone(
        self, lock: asyncio.Lock, show: Callable[[Stoppable], AbstractContextManager[None]]
    ) -> AsyncIterator[None]:
        """Hold a lock; while another tab has it, show that."""
        if lock.locked():
            waiting = Waiting()
            with show(waiting):
                await waiting.acquire(lock)
        else:
            await lock.acquire()
        try:
            yield
        finally:
            lock.release()


def file_key(path: Path) -> tuple[str, int, int]:
    """Return what tells whether a bag has changed: its files' newest time and total size."""
    files = [path] if path.is_file() else [p for p in path.iterdir() if p.is_file()]
    stats = [file.stat() for file in files]
    newest = max((s.st_mtime_ns for s in stats), default=0)
    return str(path), newest, sum(s.st_size for s in stats)
