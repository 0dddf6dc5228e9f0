# SPDX-License-Identifier: Apache-2.0
"""Work in a process of its own: its progress, its result, and how to cancel it.

Processes are forked from a small server that has imported the numerical packages and loaded their
kernels and nothing else, so that they start at once and can be ended at any time.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import multiprocessing
import os
import signal
import time
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol

from imu_recording.user_error import UserError

from imu_workbench.answer import error_line

PRELOADED_MODULE = 'imu_workbench.web.work.worker'
"""Imported once in the process that workers are forked from."""
logger = logging.getLogger(__name__)


class JobError(UserError):
    """The task failed; the message is a sentence for the user."""


class JobCancelled(Exception):  # noqa: N818 (not an error: the user asked for it)
    """The user cancelled the task."""


class Stoppable(Protocol):
    """Work under way that the user may cancel."""

    progress: str
    about: str
    """Device and version that it is done for; '' where it is for none."""
    began: float
    """[s, monotonic clock]."""
    expected_end: float | None
    """When it should be done; None: nobody knows."""

    def cancel(self) -> None:
        """Stop it."""


TASK_SECONDS = {
    'read_task': (0.4, 4e-8),
    'prepare_task': (0.5, 1e-6),
    'version_task': (1.0, 0.0),
    'change_task': (3.0, 0.0),
    'diagnose_task': (9.0, 1e-6),
    'held_out_task': (2.0, 0.0),
    'preview_task': (0.6, 0.0),
    'report_task': (15.0, 2e-6),
    'next_profile_task': (12.0, 0.0),
    'effects_task': (1.5, 0.0),
}
"""Task → seconds at the least, and per byte or sample; on two cores of 2024."""
EXPECTED_AND_SPENT_S: dict[str, tuple[float, float]] = {}
"""Task, '' for all together → seconds expected by TASK_SECONDS, and seconds spent here."""


def workload(arguments: Sequence[Any]) -> int:
    """Return the bytes of the file, or the samples of the recordings, that a task works on."""
    for argument in arguments:
        if isinstance(argument, Path) and argument.exists():
            files = [argument] if argument.is_file() else list(argument.iterdir())
            return sum(file.stat().st_size for file in files if file.is_file())
        if isinstance(argument, list) and argument and hasattr(argument[0], 'samples'):
            return sum(one.samples for one in argument)
    return 0


def expected_seconds(name: str, size: int) -> float | None:
    """Return how long a task should take here; None: nobody knows."""
    if name not in TASK_SECONDS:
        return None
    foretold, took = EXPECTED_AND_SPENT_S.get(name) or EXPECTED_AND_SPENT_S.get('', (1.0, 1.0))
    return seconds_of(name, size) * took / foretold


def seconds_of(name: str, size: int) -> float:
    """Return how long a task takes on the machine of the table."""
    least, each = TASK_SECONDS[name]
    return least + each * size


def time_left(job: Stoppable, now: float) -> str:
    """Return in words how long a job will still take; `now` by the monotonic clock [s].

    One that takes longer than was expected says how long it has taken.
    """
    if job.expected_end is None:
        return ''
    left = job.expected_end - now
    if left > 0.0:
        return f'about {max(left, 1.0):.0f} s left'
    return f'{now - job.began:.0f} s so far'


class LockWait:
    """Waiting for a lock that other work holds."""

    def __init__(self, progress: str) -> None:
        self.about, self.progress = '', progress
        self.began = time.monotonic()
        self.expected_end: float | None = None
        self._stopped = asyncio.Event()

    def cancel(self) -> None:
        """Give up waiting."""
        self._stopped.set()

    async def acquire(self, lock: asyncio.Lock | asyncio.Semaphore) -> None:
        """Take the lock; raise JobCancelled where the user gave up before."""
        taking = asyncio.ensure_future(lock.acquire())
        stopping = asyncio.ensure_future(self._stopped.wait())
        await asyncio.wait({taking, stopping}, return_when=asyncio.FIRST_COMPLETED)
        stopping.cancel()
        if self._stopped.is_set():
            if taking.done():
                lock.release()
            taking.cancel()
            raise JobCancelled


class Job:
    """One call of a function in a process of its own; the function takes `progress` first."""

    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
        self.about = self.progress = ''
        self.cancelled = False
        self._name, self._size = getattr(function, '__name__', ''), workload(arguments)
        self.began = time.monotonic()
        self._foretold = expected_seconds(self._name, self._size)
        self.expected_end = None if self._foretold is None else self.began + self._foretold
        context = start_context()
        self._connection, theirs = context.Pipe(duplex=False)
        self._process = context.Process(
            target=_run, args=(theirs, function, arguments), daemon=False
        )
        self._process.start()
        theirs.close()
        RUNNING_JOBS.add(self)

    async def result(self) -> Any:
        """Wait for what the function returns; raise JobError or JobCancelled."""
        return await asyncio.to_thread(self.wait)

    def wait(self) -> Any:
        """Wait in this thread."""
        try:
            while True:
                kind, value = self._connection.recv()
                if kind == 'progress':
                    text, share = value
                    self.hear(text, share, time.monotonic())
                    continue
                if kind == 'error':
                    raise JobError(value)
                self._learn()
                return value
        except (EOFError, OSError):
            if self.cancelled:
                raise JobCancelled from None
            raise JobError(
                'the worker process ended without a result, perhaps for lack of memory; try again '
                'with fewer or shorter bags'
            ) from None
        finally:
            self._connection.close()
            self._process.join()
            RUNNING_JOBS.discard(self)

    def hear(self, text: str, share: float, now: float) -> None:
        """Take the progress; the more is done, the more the expected end follows it."""
        self.progress = text
        if share > 0.0:
            measured = (now - self.began) / share
            known = measured if self._foretold is None else self._foretold
            self.expected_end = self.began + share * measured + (1.0 - share) * known

    def _learn(self) -> None:
        """Remember expected and spent time: their ratio is the speed of this machine."""
        if self._name in TASK_SECONDS:
            took = time.monotonic() - self.began
            for name in (self._name, ''):  # a short task says little of how long others take
                foretold, before = EXPECTED_AND_SPENT_S.get(name, (0.0, 0.0))
                EXPECTED_AND_SPENT_S[name] = (
                    foretold + seconds_of(self._name, self._size),
                    before + took,
                )

    def cancel(self) -> None:
        """End the process and those it has started."""
        self.cancelled = True
        with contextlib.suppress(ValueError):
            self._process.terminate()
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGTERM)


RUNNING_JOBS: set[Job] = set()
"""Jobs under way in this server."""


def end_all() -> None:
    """End every job."""
    for job in list(RUNNING_JOBS):
        job.cancel()


def start_context() -> Any:
    """Return the context whose server holds the imported packages; the first call starts it."""
    context = multiprocessing.get_context('forkserver')
    context.set_forkserver_preload([PRELOADED_MODULE])
    return context


def warm_up() -> None:
    """Start the server that processes are forked from."""
    with contextlib.suppress(JobError, JobCancelled, EOFError, OSError):  # it is being ended
        Job(_nothing).wait()


def _nothing(_: Callable[[str], None]) -> None:
    return None


def _tell(connection: Connection, text: str, share: float = 0.0) -> None:
    connection.send(('progress', (text, share)))


def _run(connection: Connection, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    os.setpgid(0, 0)
    try:
        value = function(partial(_tell, connection), *arguments)
        connection.send(('result', value))
    except BrokenPipeError:
        return  # the server has ended: there is no receiver
    except (UserError, OSError) as error:
        connection.send(('error', error_line(error)))
    except Exception as error:  # noqa: BLE001 (a bug: named on the page, traceback in the log)
        logging.basicConfig()
        logger.error('%s', traceback.format_exc())
        text = f'{type(error).__name__}: {error}'
        connection.send(('error', f'this is a bug in the workbench ({text}); the log has more'))
    finally:
        connection.close()
