# SPDX-License-Identifier: Apache-2.0
"""The server of the page: it reads recordings while the page's libraries are imported."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import signal
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

from imu_recording.user_error import UserError

from imu_workbench.case import lock_cases
from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.work.jobs import end_all
from imu_workbench.web.work.result_cache import ResultCache
from imu_workbench.web.work.workspace import Workspace


@dataclass(frozen=True)
class Start:
    """What a server begins with."""

    bags: tuple[Path, ...] = ()
    case: Path | None = None
    """The one case that is opened; None: those of the bags, without bags all there are."""
    model_text: str | None = None
    effects: tuple[Path, ...] = ()
    """Files with effects of the user's own."""
    remap: Mapping[str, str] = field(default_factory=dict)
    """Names of the logging contract → names in the bags."""
    local: bool = True
    """Whether only this machine can open the page."""


class PortError(UserError):
    """An address that cannot be bound."""


def bind(host: str, port: int) -> socket.socket:
    """Return a listening socket; raise PortError that says what to do."""
    family = socket.AF_INET6 if ':' in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
        listening.listen(128)
    except (OSError, OverflowError) as error:
        listening.close()
        reason = getattr(error, 'strerror', None) or str(error)
        elsewhere = (
            isinstance(error, socket.gaierror)
            or getattr(error, 'errno', None) == errno.EADDRNOTAVAIL
        )
        way_out = (
            'give an address of this machine with --host, 0.0.0.0 for all of them'
            if elsewhere
            else 'choose another with --port, or stop the program that has it'
        )
        raise PortError(f'--host {host} --port {port}: {reason}; {way_out}') from None
    return listening


def name_in_address(host: str) -> str:
    """Return what stands for a host in an address that others can open.

    >>> name_in_address('127.0.0.1'), name_in_address('::1')
    ('127.0.0.1', '[::1]')
    >>> name_in_address('0.0.0.0') == socket.gethostname()
    True
    """
    if host in {'0.0.0.0', '::', ''}:  # noqa: S104 (asked for by --host)
        return socket.gethostname()
    return f'[{host}]' if ':' in host else host


def run_server(
    listening: socket.socket,
    root: BagRoot,
    cases: Path,
    start: Start,
    *,
    token: str = '',
    ready: Callable[[], None] = lambda: None,
) -> None:
    """Serve the cases of a folder until interrupted."""
    # SIGTERM is the normal way to end a server: temporary files are removed here then, too.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with lock_cases(cases), TemporaryDirectory(prefix='imu_workbench_') as folder:
        workspace = Workspace(ResultCache(root, Path(folder)), cases, start.remap)
        with contextlib.suppress(KeyboardInterrupt):
            asyncio.run(_serve(listening, workspace, start, token, ready))


async def _serve(
    listening: socket.socket,
    workspace: Workspace,
    start: Start,
    token: str,
    ready: Callable[[], None],
) -> None:
    """Open what the server was started with, and serve the page as soon as it is imported."""
    opening = workspace.start(
        start.bags,
        start.effects,
        case=start.case,
        model_text=start.model_text,
        run_kept=start.local,
    )
    workspace.runner.begin(opening)
    try:
        application = await asyncio.to_thread(import_module, 'imu_workbench.web.application')
        await application.serve(listening, workspace, local=start.local, token=token, ready=ready)
    finally:
        end_all()  # before the loop is closed, which waits for the threads that wait for jobs
