# SPDX-License-Identifier: Apache-2.0
"""Starts servers by forking a process that has imported all that they need.

A line of JSON on standard input is a request: arguments, environment and a FIFO for what the
server writes; the answer is a line with the number of its process. Ends when the input does.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from multiprocessing import forkserver
from typing import Any

from imu_workbench.__main__ import run_process
from imu_workbench.web import application, jobs

IMPORTED = (application,)


def serve(request: dict[str, Any]) -> int:
    """Run the server that is asked for; workers are forked from the process there is."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    forkserver._forkserver.ensure_running = lambda: None  # type: ignore[method-assign]
    os.environ.clear()
    os.environ.update(request['environment'])
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(os.open(request['output'], os.O_WRONLY), 1)
    return run_process(request['arguments'])


def main() -> int:
    """Answer requests."""
    jobs.warm_up()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # whoever asked for a server waits for its end
    while line := sys.stdin.readline():
        number = os.fork()
        if number == 0:
            return serve(json.loads(line))
        sys.stdout.write(f'{number}\n')
        sys.stdout.flush()
    return 0


if __name__ == '__main__':
    sys.exit(main())
