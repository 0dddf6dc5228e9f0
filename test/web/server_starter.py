# SPDX-License-Identifier: Apache-2.0
"""Starts servers by forking a process that has imported all that they need.

A line of JSON on standard input is a request: arguments, environment, a FIFO for what the server
writes, and one that holds its fits, or its figures, back until somebody has written to it, or
none. The answer is a line with the number of its process. Where the request names `answered` bags,
that process serves nobody: it finds what is to be found in them, keeps that in the cases, and
ends. Ends when the input does.
Each worker of a server executes the top of this file again, as multiprocessing does with the main
module of whoever asks for it: what takes a second to import is imported by the functions.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
from multiprocessing import forkserver
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any


def serve(request: dict[str, Any]) -> int:
    """Run the server that is asked for; workers are forked from the process there is."""
    from imu_workbench.__main__ import run_process

    prepare(request)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(os.open(request['output'], os.O_WRONLY), 1)
    if request['held_by']:
        HOLD[request['holds']](Path(request['held_by']))
    return run_process(request['arguments'])


def answer(request: dict[str, Any]) -> int:
    """Find what is to be found in bags, as a server does that nobody looks at."""
    from imu_workbench.web.bag_root import BagRoot
    from imu_workbench.web.work.result_cache import ResultCache
    from imu_workbench.web.work.workspace import Workspace

    prepare(request)
    bags = [Path(bag) for bag in request['answered']]

    async def find(folder: str) -> None:
        cache = ResultCache(BagRoot.of(bags), Path(folder))
        workspace = Workspace(cache, Path(request['cases']))
        await workspace.start(bags, [])
        while workspace.runner.background:
            await asyncio.gather(*workspace.runner.background)

    with TemporaryDirectory() as folder:
        asyncio.run(find(folder))
    return 0


def prepare(request: dict[str, Any]) -> None:
    """Become a process of its own that forks workers from the process there is."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    forkserver._forkserver.ensure_running = lambda: None  # type: ignore[method-assign]
    os.environ.clear()
    os.environ.update(request['environment'])


def hold_fits(held_by: Path) -> None:
    """Begin no fit of this server before the file can be read to its end."""
    from imu_workbench.web.work.fit_queue import FitQueue

    run = FitQueue._run

    async def run_when_released(self: FitQueue) -> None:
        await asyncio.to_thread(held_by.read_bytes)
        await run(self)

    FitQueue._run = run_when_released  # type: ignore[method-assign]


def hold_figures(held_by: Path) -> None:
    """Compute no figure of a case before the file can be read to its end."""
    from imu_workbench.web.case import centre

    figures_of = centre.figures_of

    def figures_when_released(*arguments: Any) -> Any:
        held_by.read_bytes()
        return figures_of(*arguments)

    centre.figures_of = figures_when_released


HOLD = {'fits': hold_fits, 'figures': hold_figures}


def main() -> int:
    """Answer requests."""
    from imu_workbench.web import application  # noqa: F401 (for the servers)
    from imu_workbench.web.work import jobs

    jobs.warm_up()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # whoever asked for a server waits for its end
    while line := sys.stdin.readline():
        number = os.fork()
        if number == 0:
            request = json.loads(line)
            code = answer(request) if request.get('answered') else serve(request)
            sys.stdout.flush()
            os._exit(code)  # to take down what the fork has inherited costs a second
        sys.stdout.write(f'{number}\n')
        sys.stdout.flush()
    return 0


if __name__ == '__main__':
    sys.exit(main())
