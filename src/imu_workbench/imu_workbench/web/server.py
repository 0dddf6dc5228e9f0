# SPDX-License-Identifier: Apache-2.0
"""The server of the page."""

from __future__ import annotations

import contextlib
import errno
import signal
import socket
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory

import uvicorn
from fastapi import FastAPI, Request
from imu_recording.user_error import UserError
from nicegui import app as nicegui_app
from nicegui import ui

from imu_workbench.case import lock_cases
from imu_workbench.web.access import AccessCheck
from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.jobs import end_all
from imu_workbench.web.page import Page, Start
from imu_workbench.web.result_cache import ResultCache
from imu_workbench.web.workspace import Workspace

SCRIPTS = ('resizing.js', 'watching.js', 'cells.js', 'cursor.js', 'saving.js')
RECONNECT_S = 30.0
"""A tab that lost the server keeps its state so long."""


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
    with lock_cases(cases), TemporaryDirectory(prefix='imu_workbench_') as folder:
        workspace = Workspace(ResultCache(root, Path(folder)), cases, start.remap)
        outer = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
        outer.add_middleware(AccessCheck, token=token)
        here = files('imu_workbench') / 'web'
        look = (here / 'theme.css').read_text('utf-8')
        scripts = [(here / name).read_text('utf-8') for name in SCRIPTS]

        @ui.page('/', response_timeout=30.0)  # type: ignore[untyped-decorator]
        def _page(request: Request) -> None:
            ui.add_css(look)
            ui.add_head_html(''.join(f'<script>{script}</script>' for script in scripts))
            ui.query('.nicegui-content').classes('content')
            Page(workspace, start, dict(request.query_params))

        async def begin() -> None:
            opening = workspace.start(
                start.bags,
                start.effects,
                case=start.case,
                model_text=start.model_text,
                run_kept=start.local,
            )
            workspace.begin(opening)

        nicegui_app.on_startup(begin)
        nicegui_app.on_startup(ready)
        ui.run_with(
            outer,
            title='IMU workbench',
            favicon='📈',
            dark=None,
            language='en-US',
            reconnect_timeout=RECONNECT_S,
            show_welcome_message=False,
        )
        settings = uvicorn.Config(outer, log_level='warning', lifespan='on')
        # Being ended is the normal way to end: it must pass through here, where files are removed.
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        try:
            with contextlib.suppress(KeyboardInterrupt):
                uvicorn.Server(settings).run(sockets=[listening])
        finally:
            end_all()
