# SPDX-License-Identifier: Apache-2.0
"""Independent pieces of work, several at a time where cores are free."""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, Protocol

from imu_workbench.progress import show_progress


class Task(Protocol):
    """Something that can be done by itself; its result should be small."""

    @property
    def label(self) -> str:
        """What it is, for people."""
        ...

    @property
    def size(self) -> float:
        """How long it takes, in any unit."""
        ...

    def run(self) -> Any:
        """Do it and return the result."""
        ...


def run_tasks(tasks: Sequence[Task], workers: int) -> list[Any]:
    """Return the result of each task, in order; `workers` forked processes share the work.

    A process with threads of its own does everything itself.
    """
    if workers < 2 or len(tasks) < 2 or not may_fork():
        found = []
        for task in tasks:
            show_progress(f'{task.label} …')
            found.append(task.run())
        return found
    _WAITING[:] = tasks  # forked processes see the data without copying them
    longest_first = sorted(range(len(tasks)), key=lambda i: -tasks[i].size)
    done: dict[int, Any] = {}
    try:
        context = multiprocessing.get_context('fork')
        with ProcessPoolExecutor(min(workers, len(tasks)), mp_context=context) as pool:
            for i, result in zip(longest_first, pool.map(_run, longest_first), strict=True):
                done[i] = result
                show_progress(f'{len(done)} of {len(tasks)}: {tasks[i].label}')
    finally:
        _WAITING.clear()
    return [done[i] for i in range(len(tasks))]


def may_fork() -> bool:
    """Tell whether this process has one thread: a fork of more could wait for a lost one."""
    try:
        return len(list(Path('/proc/self/task').iterdir())) == 1
    except OSError:
        return False


_WAITING: list[Task] = []


def _run(index: int) -> Any:
    return _WAITING[index].run()
