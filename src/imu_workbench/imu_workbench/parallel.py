# SPDX-License-Identifier: Apache-2.0
"""Independent tasks on several processes, and the memory settings of such a process."""

from __future__ import annotations

import ctypes
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Protocol

from imu_workbench.answer import show_progress


class Task(Protocol):
    """Work that depends on no other task; its result goes from process to process and is small."""

    @property
    def label(self) -> str:
        """Name in the progress line."""
        ...

    @property
    def size(self) -> float:
        """How long it takes, relative to other tasks."""
        ...

    def run(self) -> Any:
        """Return the result."""
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


def start_task(task: Task, workers: int) -> Callable[[], Any]:
    """Start a task in a forked process of its own; return a function that waits for the result.

    With one worker, or in a process with threads of its own, the task runs when it is waited for.
    """
    if workers < 2 or not may_fork():
        return task.run
    context = multiprocessing.get_context('fork')
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_send_result, args=(task, sender), daemon=True)
    process.start()
    sender.close()
    return partial(_await_result, task, process, receiver)


def _await_result(task: Task, process: BaseProcess, receiver: Connection) -> Any:
    show_progress(f'{task.label} …')
    found = receiver.recv()
    process.join()
    if isinstance(found, Exception):
        raise found
    return found


def _send_result(task: Task, sender: Connection) -> None:
    try:
        sender.send(task.run())
    except Exception as error:  # noqa: BLE001 (raised again in the process that waits)
        sender.send(error)


def may_fork() -> bool:
    """Tell whether this process has one thread.

    A lock that another thread holds is never released in a forked process.
    """
    try:
        return len(list(Path('/proc/self/task').iterdir())) == 1
    except OSError:
        return False


_WAITING: list[Task] = []


def _run(index: int) -> Any:
    return _WAITING[index].run()


_TRIM_THRESHOLD, _MMAP_MAX = -1, -4
"""Parameters of glibc's mallopt."""


def keep_memory() -> bool:
    """Keep freed memory for the next array instead of returning it; tell whether that worked.

    glibc gives every large array back to the kernel and gets the next one page by page, zeroed:
    a fifth of the time of work over many columns. For processes that end with their work; where
    the C library has no such switch nothing changes.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError):
        return False
    return bool(mallopt(_MMAP_MAX, 0)) and bool(mallopt(_TRIM_THRESHOLD, 2**31 - 1))
